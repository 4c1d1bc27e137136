#include "estimation/refinement/joint/student_t.h"

#include <algorithm>
#include <array>
#include <numbers>
#include <vector>

namespace raylift {
namespace {

// The grid of degrees of freedom; the normal distribution comes after them.
constexpr std::array kDegrees = {1, 2, 3, 4, 6, 8, 12, 20, 40};

// Returns Gamma((degrees + 1) / 2) / Gamma(degrees / 2).
double GammaRatio(int degrees) {
  const double root = std::sqrt(std::numbers::pi);
  double ratio = degrees % 2 == 1 ? 1 / root : root / 2;
  for (int d = degrees % 2 == 1 ? 1 : 2; d < degrees; d += 2) ratio *= (d + 1.0) / d;
  return ratio;
}

// Returns the log-likelihood in one dimension at the likeliest squared scale, which replaces the
// start `scale2`.
double LogLikelihood(const std::vector<double>& squared, int degrees, double& scale2) {
  double sum = 0;
  for (int round = 0; round < 5; ++round) {
    sum = 0;
    for (const double e2 : squared) sum += e2 * (degrees + 1) / (degrees + e2 / scale2);
    scale2 = std::max(sum / static_cast<double>(squared.size()), 1e-12);
  }
  LogOfProduct product;
  for (const double e2 : squared) product.Multiply(1 + e2 / (degrees * scale2));
  const auto n = static_cast<double>(squared.size());
  return n * (std::log(GammaRatio(degrees)) - 0.5 * std::log(std::numbers::pi * degrees * scale2)) -
         0.5 * (degrees + 1) * product.Sum();
}

}  // namespace

double EstimateTail(std::span<const double> squared_errors, const std::optional<TailPrior>& prior) {
  const size_t stride = squared_errors.size() / kErrorsOfTail + 1;
  std::vector<double> part;
  double mean = 0;
  for (size_t i = 0; i < squared_errors.size(); i += stride) {
    part.push_back(squared_errors[i]);
    mean += part.back();
  }
  std::array<double, kDegrees.size() + 1> tails{};
  std::array<double, kDegrees.size() + 1> logs{};
  if (!part.empty()) {
    mean = std::max(mean / static_cast<double>(part.size()), 1e-12);
    double scale2 = mean;
    // The grid goes from light tails to heavy ones, each scale starting from the one before.
    logs[kDegrees.size()] =
        -0.5 * static_cast<double>(part.size()) * (std::log(2 * std::numbers::pi * mean) + 1);
    for (size_t i = kDegrees.size(); i-- > 0;) logs[i] = LogLikelihood(part, kDegrees[i], scale2);
  }
  for (size_t i = 0; i < kDegrees.size(); ++i) tails[i] = 1.0 / kDegrees[i];
  if (prior) {
    for (size_t i = 0; i < logs.size(); ++i) {
      const double off = tails[i] - prior->mean;
      logs[i] -= 0.5 * off * off / prior->variance;
    }
  }
  // Each tail of the grid stands for those that are nearest to it.
  const double most = *std::max_element(logs.begin(), logs.end());
  double sum = 0;
  double weights = 0;
  for (size_t i = 0; i < logs.size(); ++i) {
    const double above = i == 0 ? 1 : 0.5 * (tails[i] + tails[i - 1]);
    const double below = i + 1 == logs.size() ? 0 : 0.5 * (tails[i] + tails[i + 1]);
    const double weight = (above - below) * std::exp(logs[i] - most);
    sum += weight * tails[i];
    weights += weight;
  }
  return sum / weights;
}

}  // namespace raylift
