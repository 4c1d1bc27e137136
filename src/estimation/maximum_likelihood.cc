#include "estimation/maximum_likelihood.h"

#include <set>

#include "estimation/noise_variance.h"
#include "estimation/reliable_pairs.h"
#include <Eigen/Cholesky>

namespace raylift {
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

template <typename PreparedMatch>
std::vector<int> IndicesOf(const std::vector<PreparedMatch>& prepared,
                           const std::set<int>& matches) {
  std::vector<int> indices;
  for (int i = 0; i < static_cast<int>(prepared.size()); ++i) {
    if (matches.contains(prepared[static_cast<size_t>(i)].match)) indices.push_back(i);
  }
  return indices;
}

}  // namespace

void MaximumLikelihood::Refine(const SolverPose& start) {
  pose_ = start;
  // The noise is estimated at the pose that the noise's estimate shapes: twice is enough.
  for (int round = 0; round < 2; ++round) {
    Gather();
    Minimize();
  }
}

void MaximumLikelihood::StayAt(const SolverPose& pose) {
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

// By least squares of the matches within two and a half standard deviations: the differences are
// then of the same cost as the Gauss-Newton matrix.
std::optional<FocalStep> MaximumLikelihood::StepOfFocal(const PreparedProblem& shorter,
                                                        const PreparedProblem& longer,
                                                        double log_factor) const {
  const Residuals residuals = ComputeResiduals(problem_, pose_, kinds_);
  constexpr double kNear = kSigmasOfThreshold * kSigmasOfThreshold;
  const auto matches_near = [](const auto& matches, const std::vector<double>& squared,
                               double weight) {
    std::set<int> near;
    for (size_t i = 0; i < squared.size(); ++i) {
      if (squared[i] * weight < kNear) near.insert(matches[i].match);
    }
    return near;
  };
  std::set<int> points;
  std::set<int> pairs;
  if (kinds_.points) {
    points = matches_near(problem_.points, residuals.points, weights_.point_weight);
  }
  if (kinds_.pairs) pairs = matches_near(problem_.pairs, residuals.pairs, weights_.pair_weight);
  KindWeights weights = weights_;
  const auto squared = [](double weight) {  // as far as these matches lie
    return kernels::KernelLoss{kernels::LossShape::kTruncated, 4 * kNear / weight};
  };
  weights.point_loss = squared(weights.point_weight);
  weights.pair_loss = squared(weights.pair_weight);
  bool complete = true;
  const auto linearize = [&](const PreparedProblem& problem) {
    const std::vector<int> of_points = IndicesOf(problem.points, points);
    const std::vector<int> of_pairs = IndicesOf(problem.pairs, pairs);
    complete = complete && of_points.size() == points.size() && of_pairs.size() == pairs.size();
    const GatheredMatches gathered = {MakePointBlocks<double>(problem.points, of_points),
                                      MakePairBlocks<double>(problem.pairs, of_pairs)};
    return Linearize(problem, gathered.Active(), pose_, weights);
  };
  const NormalEquations at = linearize(problem_);
  const NormalEquations below = linearize(shorter);
  const NormalEquations above = linearize(longer);
  if (!complete) return std::nullopt;
  FocalEquations equations;
  equations.hessian = at.hessian;
  equations.gradient = at.gradient;
  equations.mixed = (above.gradient - below.gradient) / (2 * log_factor);
  // Halves, as the gradient is.
  equations.slope = (above.cost - below.cost) / (4 * log_factor);
  equations.curvature = (above.cost - 2 * at.cost + below.cost) / (2 * log_factor * log_factor);
  return equations.Solve();
}

// The matches near the pose, and what they say of the noise.
void MaximumLikelihood::Gather() {
  const Residuals residuals = ComputeResiduals(problem_, pose_, kinds_);
  const double point_variance = NoiseVariance(residuals.points, kPointNoise);
  const double pair_variance = NoiseVariance(residuals.pairs, kPairNoise);
  weights_ = {.point_weight = 1 / point_variance,
              .pair_weight = 1 / pair_variance,
              .prior_weight = 1,
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

void MaximumLikelihood::Minimize() {
  pose_ = raylift::Minimize(problem_, near_.Active(), pose_, weights_, 20, 1e-9);
}

}  // namespace raylift
