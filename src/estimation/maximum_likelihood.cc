#include "estimation/maximum_likelihood.h"

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

std::optional<FocalStep> MaximumLikelihood::StepOfFocal(const PreparedProblem& shorter,
                                                        const PreparedProblem& longer,
                                                        double log_factor) const {
  const auto linearize = [&](const PreparedProblem& problem) {
    return Linearize(problem, Select(problem).Active(), pose_, weights_);
  };
  const NormalEquations at = linearize(problem_);
  const NormalEquations below = linearize(shorter);
  const NormalEquations above = linearize(longer);
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
  selection_ = {};
  if (kinds_.points) selection_.points = IndicesBelow(residuals.points, kNearSquared);
  if (kinds_.pairs) {
    selection_.pairs = ReliablePairs(problem_, pose_, residuals.pairs, pair_variance, kNearSquared);
  }
  near_ = Select(problem_);
}

MaximumLikelihood::GatheredMatches MaximumLikelihood::Select(const PreparedProblem& problem) const {
  return {MakePointBlocks<double>(problem.points, selection_.points),
          MakePairBlocks<double>(problem.pairs, selection_.pairs)};
}

void MaximumLikelihood::Minimize() {
  pose_ = raylift::Minimize(problem_, near_.Active(), pose_, weights_, 20, 1e-9);
}

}  // namespace raylift
