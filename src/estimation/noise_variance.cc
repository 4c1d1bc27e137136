#include "estimation/noise_variance.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimation/match_residuals.h"

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

constexpr NoiseModel kPointNoise = {MeanSquareBelow2D, 30};
constexpr NoiseModel kPairNoise = {MeanSquareBelow1D, 22};

double NoiseVariance(const std::vector<double>& squared_residuals, const NoiseModel& model) {
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

}  // namespace raylift
