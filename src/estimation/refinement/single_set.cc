#include "estimation/refinement/single_set.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "base/statistics.h"
#include "estimation/problem/normalized_problem.h"
#include <Eigen/Cholesky>
#include <Eigen/Geometry>

namespace raylift {
namespace {

constexpr double kPriorMatches = 4;

double MeanSquareBelow1D(double squared_limit) {
  const double limit = std::sqrt(squared_limit);
  const double density = std::exp(-0.5 * squared_limit) / std::sqrt(2 * std::numbers::pi);
  return 1 - 2 * limit * density / std::erf(limit / std::numbers::sqrt2);
}
double MeanSquareBelow2D(double squared_limit) {
  const double rest = std::exp(-0.5 * squared_limit);
  return 2 - squared_limit * rest / (1 - rest);
}

}  // namespace

constexpr ResidualModel kModel2D3D = {MeanSquareBelow2D, 30};
constexpr ResidualModel kModel2D2D = {MeanSquareBelow1D, 22};

double NoiseVariance(const std::vector<double>& squared_residuals, const ResidualModel& model) {
  // No keypoint is better than a hundredth of the threshold, and a few matches that fit perfectly
  // must not silence the others.
  constexpr double kSmallest = 1e-4;
  constexpr double kLargest = 100;
  double variance = 0.1;
  for (int i = 0; i < 30; ++i) {
    const double limit = std::min(6.25 * variance, kNearSquared);
    double sum = 0;
    int count = 0;
    for (const double e2 : squared_residuals) {
      if (e2 < limit) {
        sum += e2;
        ++count;
      }
    }
    // The prior weighs as much as kPriorMatches matches.
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

kernels::KernelLoss RobustLoss(double variance, const ResidualModel& model) {
  return {kernels::LossShape::kBiweight,
          std::min(model.squared_loss_limit * variance, kNearSquared)};
}

namespace {

// Parallaxes over the median one are sorted into bins that end here; the last is open.
constexpr std::array kBinEnds = {1.5, 2.0, 3.0, 4.5, 7.0};
constexpr size_t kNumBins = kBinEnds.size() + 1;

// A bin is trusted if no more than this share of its matches is there by chance.
constexpr double kMaxChanceShare = 0.1;

// Right matches lie within so many standard deviations; beyond twice as many there are none.
constexpr double kInnerSigmas = 2.5;
// Wrong ones are counted up to so many thresholds.
constexpr double kOuterThresholds = 10;

// Returns the sine of the angle at the point over the baseline's length: about the inverse
// distance.
double InverseDistance(const NormalizedProblem& problem, const CamFromLocal& pose,
                       const NormalizedMatch2D2D& pair) {
  const Eigen::Vector3d baseline = pose.rotation * problem.centers[pair.reference] +
                                   problem.PoseOfCamera(pose, pair.camera).translation;
  const Eigen::Vector3d reference_ray = pose.rotation * pair.reference_ray;
  return reference_ray.cross(pair.query_ray).norm() / baseline.norm();
}

struct Bin {
  int inner = 0;
  int outer = 0;
};

}  // namespace

std::vector<int> ReliableMatches2D2D(const NormalizedProblem& problem, const CamFromLocal& pose,
                                     const std::vector<double>& squared_residuals, double variance,
                                     double limit) {
  const double inner = kInnerSigmas * std::sqrt(variance);
  const double outer_begin = 2 * inner;
  // Wide enough to count in, whatever the noise.
  const double outer_end = std::max(kOuterThresholds, 2 * outer_begin);

  std::vector<int> counted;
  std::vector<double> inverse_distances;  // of the counted
  std::vector<double> inner_distances;
  for (int i = 0; i < static_cast<int>(squared_residuals.size()); ++i) {
    if (squared_residuals[i] < outer_end * outer_end) {
      counted.push_back(i);
      inverse_distances.push_back(InverseDistance(problem, pose, problem.matches_2d2d[i]));
      if (squared_residuals[i] < inner * inner) inner_distances.push_back(inverse_distances.back());
    }
  }
  if (inner_distances.empty()) {
    return {};
  }
  const double median = UpperMedianInPlace(std::span(inner_distances));
  const auto bin_of = [median](double inverse_distance) {
    size_t bin = 0;
    while (bin < kBinEnds.size() && inverse_distance > kBinEnds[bin] * median) ++bin;
    return bin;
  };

  std::array<Bin, kNumBins> bins;
  for (size_t k = 0; k < counted.size(); ++k) {
    Bin& bin = bins[bin_of(inverse_distances[k])];
    const double e2 = squared_residuals[counted[k]];
    bin.inner += e2 < inner * inner ? 1 : 0;
    bin.outer += e2 > outer_begin * outer_begin ? 1 : 0;
  }
  // Residuals of wrong matches are spread evenly.
  const double inner_share = inner / (outer_end - outer_begin);
  std::vector<int> reliable;
  for (size_t k = 0; k < counted.size(); ++k) {
    const Bin& bin = bins[bin_of(inverse_distances[k])];
    if (squared_residuals[counted[k]] < limit &&
        bin.outer * inner_share <= kMaxChanceShare * bin.inner) {
      reliable.push_back(counted[k]);
    }
  }
  return reliable;
}

namespace {

std::vector<int> IndicesBelow(const std::vector<double>& values, double limit) {
  std::vector<int> indices;
  for (int i = 0; i < static_cast<int>(values.size()); ++i) {
    if (values[i] < limit) {
      indices.push_back(i);
    }
  }
  return indices;
}

}  // namespace

void MaximumLikelihood::Refine(const CamFromLocal& start) {
  pose_ = start;
  // The noise is estimated at the pose that the noise's estimate shapes: twice is enough.
  for (int round = 0; round < 2; ++round) {
    Gather();
    Minimize();
  }
}

void MaximumLikelihood::StayAt(const CamFromLocal& pose) {
  pose_ = pose;
  Gather();
}

std::optional<Matrix6d> MaximumLikelihood::Covariance() const {
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

MaximumLikelihood::GatheredMatches MaximumLikelihood::WithFocal(const GatheredMatches& matches,
                                                                double log_factor) const {
  GatheredMatches moved = matches;
  constexpr int kLanes = kernels::kLanes<double>;
  for (size_t i = 0; i < moved.blocks_2d3d.lane_match.size(); ++i) {
    const int match = moved.blocks_2d3d.lane_match[i];
    if (match < 0) continue;
    auto& image_from_ray = moved.blocks_2d3d.blocks[i / kLanes].image_from_ray;
    const Eigen::Vector2d move =
        log_factor / problem_.reprojection_threshold_px * problem_.focal.px_2d3d[match];
    for (int row = 0; row < 2; ++row) {
      for (int k = 0; k < 3; ++k) {
        image_from_ray[3 * row + k][i % kLanes] += move[row] * image_from_ray[6 + k][i % kLanes];
      }
    }
  }
  for (size_t i = 0; i < moved.blocks_2d2d.lane_match.size(); ++i) {
    const int match = moved.blocks_2d2d.lane_match[i];
    if (match < 0) continue;
    auto& query_ray = moved.blocks_2d2d.blocks[i / kLanes].query_ray;
    const Eigen::Vector3d move =
        problem_.matches_2d2d[match].query_gradient *
        (log_factor / problem_.sampson_threshold_px * problem_.focal.px_2d2d[match]);
    for (int k = 0; k < 3; ++k) query_ray[k][i % kLanes] -= move[k];
  }
  return moved;
}

// Takes least squares of the matches within two and a half standard deviations: the differences are
// then of the same cost as the Gauss-Newton matrix.
std::optional<FocalStep> MaximumLikelihood::StepOfFocal() const {
  constexpr double kNear = kSigmasOfThreshold * kSigmasOfThreshold;
  const Residuals residuals = ComputeResiduals(problem_, pose_, sets_);
  GatheredMatches near;
  if (Has2D3D(sets_)) {
    near.blocks_2d3d = MakeBlocks2D3D<double>(
        problem_.matches_2d3d, IndicesBelow(residuals.of_2d3d, kNear / weights_.weight_2d3d));
  }
  if (Has2D2D(sets_)) {
    near.blocks_2d2d = MakeBlocks2D2D<double>(
        problem_.matches_2d2d, IndicesBelow(residuals.of_2d2d, kNear / weights_.weight_2d2d));
  }
  MatchSetWeights weights = weights_;
  const auto squared = [](double weight) {  // as far as these matches lie
    return kernels::KernelLoss{kernels::LossShape::kTruncated, 4 * kNear / weight};
  };
  weights.loss_2d3d = squared(weights.weight_2d3d);
  weights.loss_2d2d = squared(weights.weight_2d2d);
  const auto linearize = [&](const GatheredMatches& matches) {
    return Linearize(problem_, matches.Active(), pose_, weights);
  };
  constexpr double kDifference = 1e-4;
  const NormalEquations at = linearize(near);
  const NormalEquations below = linearize(WithFocal(near, -kDifference));
  const NormalEquations above = linearize(WithFocal(near, kDifference));
  FocalEquations equations;
  equations.hessian = at.hessian;
  equations.gradient = at.gradient;
  equations.mixed = (above.gradient - below.gradient) / (2 * kDifference);
  // Halves, as the gradient is.
  equations.slope = (above.cost - below.cost) / (4 * kDifference);
  equations.curvature = (above.cost - 2 * at.cost + below.cost) / (2 * kDifference * kDifference);
  return equations.Solve();
}

// Gathers the matches near the pose, and estimates their noise.
void MaximumLikelihood::Gather() {
  const Residuals residuals = ComputeResiduals(problem_, pose_, sets_);
  const double variance_2d3d = NoiseVariance(residuals.of_2d3d, kModel2D3D);
  const double variance_2d2d = NoiseVariance(residuals.of_2d2d, kModel2D2D);
  weights_ = {.weight_2d3d = 1 / variance_2d3d,
              .weight_2d2d = 1 / variance_2d2d,
              .prior_weight = 1,
              .loss_2d3d = RobustLoss(variance_2d3d, kModel2D3D),
              .loss_2d2d = RobustLoss(variance_2d2d, kModel2D2D)};
  near_ = {};
  if (Has2D3D(sets_)) {
    near_.blocks_2d3d = MakeBlocks2D3D<double>(problem_.matches_2d3d,
                                               IndicesBelow(residuals.of_2d3d, kNearSquared));
  }
  if (Has2D2D(sets_)) {
    near_.blocks_2d2d = MakeBlocks2D2D<double>(
        problem_.matches_2d2d,
        ReliableMatches2D2D(problem_, pose_, residuals.of_2d2d, variance_2d2d, kNearSquared));
  }
}

void MaximumLikelihood::Minimize() {
  pose_ = raylift::Minimize(problem_, near_.Active(), pose_, weights_, 20, 1e-9);
}

}  // namespace raylift
