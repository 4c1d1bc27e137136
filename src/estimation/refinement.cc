#include "estimation/refinement.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <span>

#include "estimation/kernels/kernel_table.h"
#include "estimation/reliable_pairs.h"
#include <Eigen/Cholesky>

#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

// Near enough to a pose to become inliers in a few steps: three thresholds.
constexpr double kNearSquared = 9;

// Where both kinds disagree by more than noise explains (one case in 100), the geometry is to
// blame, which pairs do not need: its errors are common to many points, and their residuals do not
// show them. The refinement then starts anew from where the pairs alone lead, and the points'
// variance is raised fourfold until both agree well.
constexpr double kLargestPull = 16.8;
constexpr double kSettledPull = 0.5;
constexpr int kMaxInflations = 8;
constexpr int kStepsOfPairsAlone = 20;

// Noise that is assumed as if so many matches had shown it, in units of the squared threshold.
constexpr double kPriorVariance = 0.1;
constexpr double kPriorMatches = 4;

// The matches that a refinement works on; blocks that live elsewhere.
template <typename T>
struct ActiveMatches {
  std::span<const kernels::PointBlock<T>> point_blocks;
  std::span<const kernels::PairBlock<T>> pair_blocks;
  std::span<const int> pair_block_reference;
};

struct KindWeights {
  double point_weight = 1;
  double pair_weight = 1;
  kernels::KernelLoss point_loss;
  kernels::KernelLoss pair_loss;
};

struct NormalEquations {
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double cost = 0;

  void Add(const kernels::KernelNormals& normals, double weight) {
    int k = 0;
    for (int r = 0; r < 6; ++r) {
      gradient[r] += weight * normals.gradient[r];
      for (int c = r; c < 6; ++c, ++k) {
        hessian(r, c) += weight * normals.hessian[k];
        hessian(c, r) = hessian(r, c);
      }
    }
    cost += weight * normals.cost;
  }
};

kernels::KernelNormals PointNormals(const ActiveMatches<float>& m,
                                    const kernels::KernelPose<float>& pose,
                                    const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().point_normals_float(
      m.point_blocks.data(), static_cast<int>(m.point_blocks.size()), pose, loss);
}
kernels::KernelNormals PointNormals(const ActiveMatches<double>& m,
                                    const kernels::KernelPose<double>& pose,
                                    const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().point_normals(
      m.point_blocks.data(), static_cast<int>(m.point_blocks.size()), pose, loss);
}
kernels::KernelNormals PairNormals(const ActiveMatches<float>& m,
                                   const kernels::KernelPose<float>& pose,
                                   const std::vector<float>& centres,
                                   const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().pair_normals_float(
      m.pair_blocks.data(), m.pair_block_reference.data(), static_cast<int>(m.pair_blocks.size()),
      pose, centres.data(), loss);
}
kernels::KernelNormals PairNormals(const ActiveMatches<double>& m,
                                   const kernels::KernelPose<double>& pose,
                                   const std::vector<double>& centres,
                                   const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().pair_normals(m.pair_blocks.data(), m.pair_block_reference.data(),
                                               static_cast<int>(m.pair_blocks.size()), pose,
                                               centres.data(), loss);
}

template <typename T>
NormalEquations Linearize(const PreparedProblem& problem, const ActiveMatches<T>& matches,
                          const SolverPose& pose, const KindWeights& weights) {
  NormalEquations equations;
  const auto kernel_pose = ToKernelPose<T>(pose);
  if (!matches.point_blocks.empty()) {
    equations.Add(PointNormals(matches, kernel_pose, weights.point_loss), weights.point_weight);
  }
  if (!matches.pair_blocks.empty()) {
    equations.Add(
        PairNormals(matches, kernel_pose, CentresInCam<T>(problem, pose), weights.pair_loss),
        weights.pair_weight);
  }
  return equations;
}

SolverPose Moved(const SolverPose& pose, const Vector6d& step) {
  const Eigen::Matrix3d turn = RotationFromVector(step.head<3>()).toRotationMatrix();
  return {turn * pose.rotation, turn * pose.translation + step.tail<3>()};
}

// Levenberg-Marquardt with Marquardt's scaling, which makes the damping blind to units.
template <typename T>
SolverPose Minimize(const PreparedProblem& problem, const ActiveMatches<T>& matches,
                    SolverPose pose, const KindWeights& weights, int max_steps,
                    double relative_tolerance) {
  NormalEquations equations = Linearize(problem, matches, pose, weights);
  double damping = 1e-4;
  for (int i = 0; i < max_steps; ++i) {
    Matrix6d damped = equations.hessian;
    const double floor = 1e-12 * damped.diagonal().maxCoeff();
    damped.diagonal() += damping * damped.diagonal() + Vector6d::Constant(floor);
    const Vector6d step = damped.ldlt().solve(-equations.gradient);
    if (!step.allFinite() || step.head<3>().norm() > 1) {
      break;
    }
    const SolverPose candidate = Moved(pose, step);
    const NormalEquations next = Linearize(problem, matches, candidate, weights);
    if (next.cost < equations.cost) {
      const double gain = equations.cost - next.cost;
      pose = candidate;
      equations = next;
      damping *= 0.1;
      if (gain < relative_tolerance * next.cost) {
        break;
      }
    } else {
      damping *= 10;
      if (damping > 1e4 || step.norm() < 1e-10) {
        break;
      }
    }
  }
  // Many small turns leave the matrix a rounding error away from a rotation.
  pose.rotation = Eigen::Quaterniond(pose.rotation).normalized().toRotationMatrix();
  return pose;
}

// Local optimization needs no more matches than these of each kind to come as near as its score can
// tell; the final refinement takes all. Blocks are in random order.
constexpr size_t kBlocksToReach = 24;
constexpr size_t kBlocksToSettle = 32;

template <typename T>
ActiveMatches<T> FirstBlocks(ActiveMatches<T> matches, size_t count) {
  matches.point_blocks = matches.point_blocks.first(std::min(matches.point_blocks.size(), count));
  matches.pair_blocks = matches.pair_blocks.first(std::min(matches.pair_blocks.size(), count));
  return matches;
}

// Blocks of some matches, for a refinement.
struct GatheredMatches {
  std::vector<kernels::PointBlock<double>> points;
  PairBlocks<double> pairs;

  ActiveMatches<double> Active() const { return {points, pairs.blocks, pairs.block_reference}; }
};

// The matches whose squared residual is below `limit`.
std::vector<int> IndicesBelow(const std::vector<double>& values, double limit) {
  std::vector<int> indices;
  for (int i = 0; i < static_cast<int>(values.size()); ++i) {
    if (values[i] < limit) {
      indices.push_back(i);
    }
  }
  return indices;
}

// What the noise of one kind of residual is estimated with: the mean square of a residual of unit
// variance that is cut at a limit, and where the robust loss ends for unit variance.
struct NoiseModel {
  double (*mean_square_below)(double squared_limit);
  double squared_loss_limit;  // 95 % of the efficiency of least squares on normal residuals
};

// Pairs have one residual, points two.
double MeanSquareBelow1D(double squared_limit) {
  const double limit = std::sqrt(squared_limit);
  const double density = std::exp(-0.5 * squared_limit) / std::sqrt(2 * std::numbers::pi);
  return 1 - 2 * limit * density / std::erf(limit / std::numbers::sqrt2);
}
double MeanSquareBelow2D(double squared_limit) {
  const double rest = std::exp(-0.5 * squared_limit);
  return 2 - squared_limit * rest / (1 - rest);
}
constexpr NoiseModel kPairNoise = {MeanSquareBelow1D, 22};
constexpr NoiseModel kPointNoise = {MeanSquareBelow2D, 30};

// The variance of one residual component in units of the squared threshold: the one that explains
// the mean square of the residuals within two and a half standard deviations. Where the residuals
// spread evenly over all that lies near, as with inaccurate geometry, it grows beyond bounds.
double NoiseVariance(const std::vector<double>& squared, const NoiseModel& model) {
  // No keypoint is better than a hundredth of the threshold, and a few matches that fit perfectly
  // must not silence the others.
  constexpr double kSmallest = 1e-4;
  constexpr double kLargest = 100;
  double variance = 0.1;
  for (int i = 0; i < 30; ++i) {
    const double limit = std::min(6.25 * variance, kNearSquared);
    double sum = 0;
    int count = 0;
    for (const double e2 : squared) {
      if (e2 < limit) {
        sum += e2;
        ++count;
      }
    }
    // A prior of the weight of a few matches.
    const double expected = model.mean_square_below(limit / variance);
    const double next = std::clamp(
        (sum + kPriorMatches * expected * kPriorVariance) / ((count + kPriorMatches) * expected),
        kSmallest, kLargest);
    const bool settled = std::abs(next - variance) < 0.01 * variance;
    variance = next;
    if (settled) break;
  }
  return variance;
}

kernels::KernelLoss RobustLoss(double variance, const NoiseModel& model) {
  return {kernels::LossShape::kBiweight,
          std::min(model.squared_loss_limit * variance, kNearSquared)};
}

std::vector<int> AllIndices(size_t count) {
  std::vector<int> indices(count);
  std::iota(indices.begin(), indices.end(), 0);
  return indices;
}

std::vector<double> PointResiduals(const PreparedProblem& problem, const SolverPose& pose) {
  const auto blocks = MakePointBlocks<double>(problem.points, AllIndices(problem.points.size()));
  std::vector<double> residuals(blocks.size() * kernels::kLanes<double>);
  kernels::ActiveKernels().point_residuals(blocks.data(), static_cast<int>(blocks.size()),
                                           ToKernelPose<double>(pose), residuals.data());
  residuals.resize(problem.points.size());
  return residuals;
}

std::vector<double> PairResiduals(const PreparedProblem& problem, const SolverPose& pose) {
  const auto blocks = MakePairBlocks<double>(problem.pairs, AllIndices(problem.pairs.size()));
  const auto centres = CentresInCam<double>(problem, pose);
  std::vector<double> lanes(blocks.lane_pair.size());
  kernels::ActiveKernels().pair_residuals(blocks.blocks.data(), blocks.block_reference.data(),
                                          static_cast<int>(blocks.blocks.size()),
                                          ToKernelPose<double>(pose), centres.data(), lanes.data());
  std::vector<double> residuals(problem.pairs.size());
  for (size_t i = 0; i < lanes.size(); ++i) {
    if (blocks.lane_pair[i] >= 0) {
      residuals[blocks.lane_pair[i]] = lanes[i];
    }
  }
  return residuals;
}

// Refines a pose with each kind's noise estimated from its own inliers.
class MaximumLikelihood {
 public:
  MaximumLikelihood(const PreparedProblem& problem, ResidualKinds kinds)
      : problem_(problem), kinds_(kinds) {}

  void Refine(const SolverPose& start) {
    pose_ = start;
    // The noise is estimated at the pose that the noise's estimate shapes: twice is enough.
    for (int round = 0; round < 2; ++round) {
      Gather();
      Minimize();
    }
  }

  // How far the points hold the pose away from where the pairs alone want it: the squared
  // Mahalanobis length of the pairs' own step. Chi-squared with at most six degrees of freedom if
  // both kinds agree but for noise.
  double PullOnPairs() const {
    ActiveMatches<double> pairs_alone = near_.Active();
    pairs_alone.point_blocks = {};
    NormalEquations pairs = Linearize(problem_, pairs_alone, pose_, weights_);
    // Directions that the pairs do not determine pull at nothing.
    pairs.hessian.diagonal() += Vector6d::Constant(1e-9 * pairs.hessian.diagonal().maxCoeff());
    return pairs.gradient.dot(pairs.hessian.ldlt().solve(pairs.gradient));
  }

  void DistrustPoints() {
    for (int i = 0; i < kMaxInflations && PullOnPairs() > kSettledPull; ++i) {
      weights_.point_weight *= 0.25;
      Minimize();
    }
  }

  // Of the step (w, v) in the camera's tangent frame; none where singular.
  std::optional<Matrix6d> Covariance() const {
    const NormalEquations equations = Linearize(problem_, near_.Active(), pose_, weights_);
    const Eigen::LDLT<Matrix6d> factors(equations.hessian);
    if (!factors.isPositive() || !(factors.rcond() > 1e-13)) {
      return std::nullopt;
    }
    const Matrix6d covariance = factors.solve(Matrix6d::Identity());
    if (!covariance.allFinite()) {
      return std::nullopt;
    }
    return Matrix6d(0.5 * (covariance + covariance.transpose()));
  }

  const SolverPose& pose() const { return pose_; }

 private:
  // The matches near the pose, and what they say of the noise.
  void Gather() {
    const Residuals residuals = ComputeResiduals(problem_, pose_, kinds_);
    const double point_variance = NoiseVariance(residuals.points, kPointNoise);
    const double pair_variance = NoiseVariance(residuals.pairs, kPairNoise);
    weights_ = {.point_weight = 1 / point_variance,
                .pair_weight = 1 / pair_variance,
                .point_loss = RobustLoss(point_variance, kPointNoise),
                .pair_loss = RobustLoss(pair_variance, kPairNoise)};
    near_ = {};
    if (kinds_.points) {
      near_.points =
          MakePointBlocks<double>(problem_.points, IndicesBelow(residuals.points, kNearSquared));
    }
    if (kinds_.pairs) {
      near_.pairs = MakePairBlocks<double>(
          problem_.pairs,
          ReliablePairs(problem_, pose_, residuals.pairs, pair_variance, kNearSquared));
    }
  }

  void Minimize() {
    pose_ = raylift::Minimize(problem_, near_.Active(), pose_, weights_, 20, 1e-9);
  }

  const PreparedProblem& problem_;
  ResidualKinds kinds_;
  SolverPose pose_;
  KindWeights weights_;
  GatheredMatches near_;
};

}  // namespace

Residuals ComputeResiduals(const PreparedProblem& problem, const SolverPose& pose,
                           ResidualKinds kinds) {
  Residuals residuals;
  if (kinds.points) residuals.points = PointResiduals(problem, pose);
  if (kinds.pairs) residuals.pairs = PairResiduals(problem, pose);
  return residuals;
}

SolverPose OptimizeLocally(const PreparedProblem& problem, const SolverPose& pose,
                           ResidualKinds kinds, int max_steps) {
  ActiveMatches<float> active;
  if (kinds.points) {
    active.point_blocks = problem.point_blocks;
  }
  if (kinds.pairs) {
    active.pair_blocks = problem.pair_blocks;
    active.pair_block_reference = problem.pair_block_reference;
  }
  // A minimal sample's pose may be so far off that many inliers lie beyond the threshold: first
  // reach for those, then settle on the score's own cost.
  KindWeights wide;
  wide.point_loss.limit = wide.pair_loss.limit = kNearSquared;
  const SolverPose near =
      Minimize(problem, FirstBlocks(active, kBlocksToReach), pose, wide, 2, 1e-2);
  return Minimize(problem, FirstBlocks(active, kBlocksToSettle), near, KindWeights{}, max_steps,
                  1e-4);
}

namespace {

double PairCost(const PreparedProblem& problem, const SolverPose& pose) {
  double cost = 0;
  for (const double e2 : PairResiduals(problem, pose)) {
    cost += std::min(e2, 1.0);
  }
  return cost;
}

// Where the pairs lead from a pose, or what a search by them finds if that fits them better.
SolverPose BestByPairs(const PreparedProblem& problem, const SolverPose& pose,
                       const PoseSearch& search_by_pairs) {
  constexpr ResidualKinds kPairsAlone{.points = false, .pairs = true};
  const SolverPose led = OptimizeLocally(problem, pose, kPairsAlone, kStepsOfPairsAlone);
  const auto found = search_by_pairs ? search_by_pairs() : std::nullopt;
  return found && PairCost(problem, *found) < PairCost(problem, led) ? *found : led;
}

}  // namespace

FinalPose RefineFinally(const PreparedProblem& problem, const SolverPose& pose, ResidualKinds kinds,
                        const PoseSearch& search_by_pairs) {
  MaximumLikelihood refinement(problem, kinds);
  refinement.Refine(pose);
  if (kinds.points && kinds.pairs && refinement.PullOnPairs() > kLargestPull) {
    refinement.Refine(BestByPairs(problem, pose, search_by_pairs));
    refinement.DistrustPoints();
  }
  return {refinement.pose(), refinement.Covariance()};
}

}  // namespace raylift
