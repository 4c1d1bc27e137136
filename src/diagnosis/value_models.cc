#include "diagnosis/value_models.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "base/index_sets.h"
#include "base/rng.h"
#include <Eigen/Core>
#include <Eigen/LU>

namespace raylift {
namespace {

// Hardly any two pixels of a continuous map agree.
constexpr size_t kMinPixelsPerValue = 3;
constexpr size_t kMinValues = 3;
// Values of one step agree with this relative precision: that of float, and of interpolation
// between equal ones.
constexpr double kSame = 1e-6;
// A value may miss its step by this share of it, and this share of values may miss it by more:
// interpolation between steps gives some.
constexpr double kMaxMiss = 0.1;
constexpr double kMostMissing = 0.05;

// `values` are sorted and different.
std::optional<ValueSteps> FitSteps(const std::vector<double>& values) {
  double step = values.back() - values.front();
  for (size_t i = 1; i < values.size(); ++i) step = std::min(step, values[i] - values[i - 1]);
  // Counting steps from value to value keeps the error of the smallest one from adding up.
  double steps = 0;
  for (size_t i = 1; i < values.size(); ++i) {
    steps += std::round((values[i] - values[i - 1]) / step);
  }
  step = (values.back() - values.front()) / steps;
  size_t missing = 0;
  for (const double value : values) {
    const double place = (value - values.front()) / step;
    missing += std::abs(place - std::round(place)) > kMaxMiss;
  }
  if (static_cast<double>(missing) > kMostMissing * static_cast<double>(values.size())) {
    return std::nullopt;
  }
  return ValueSteps{values.front(), step, values.back()};
}

constexpr double kLossWidthPx = 3;

double RobustCost(std::span<const LineSample> samples, double factor, double shift) {
  double cost = 0;
  for (const LineSample& s : samples) {
    const double error_px = (factor * s.value + shift - s.target) / s.target * s.px;
    cost += std::log1p(error_px * error_px / (kLossWidthPx * kLossWidthPx));
  }
  return cost;
}

}  // namespace

size_t CountAt(std::span<const double> values, double at, double tolerance) {
  return static_cast<size_t>(std::count_if(values.begin(), values.end(), [&](double value) {
    return std::abs(value - at) <= tolerance * at;
  }));
}

std::optional<ValueLine> FitLine(std::span<const double> x, std::span<const double> y) {
  const auto n = static_cast<double>(x.size());
  const Eigen::Map<const Eigen::ArrayXd> a(x.data(), static_cast<Eigen::Index>(x.size()));
  const Eigen::Map<const Eigen::ArrayXd> b(y.data(), static_cast<Eigen::Index>(y.size()));
  if (x.empty()) return std::nullopt;
  const double mean_a = a.sum() / n, mean_b = b.sum() / n;
  const double variance = (a - mean_a).square().sum();
  if (!(variance > 0)) return std::nullopt;
  const double factor = ((a - mean_a) * (b - mean_b)).sum() / variance;
  return ValueLine{factor, mean_b - factor * mean_a};
}

std::optional<ValueLine> FitLineRobustly(std::span<const LineSample> samples) {
  constexpr size_t kFewest = 20;
  constexpr int kDraws = 200;
  constexpr size_t kJudges = 500;
  constexpr int kIterations = 10;
  if (samples.size() < kFewest) return std::nullopt;
  Rng rng(samples.size());
  ValueLine best = {0, 0};
  double best_cost = std::numeric_limits<double>::infinity();
  // Draws are judged by some of the samples.
  std::vector<LineSample> some;
  for (const size_t i : EvenlySpaced(samples.size(), kJudges)) some.push_back(samples[i]);
  for (int draw = 0; draw < kDraws; ++draw) {
    const auto count = static_cast<uint32_t>(samples.size());
    const LineSample& s = samples[rng.UniformIndex(count)];
    const LineSample& t = samples[rng.UniformIndex(count)];
    if (s.value == t.value) continue;
    const double factor = (s.target - t.target) / (s.value - t.value);
    const double shift = s.target - factor * s.value;
    if (!(factor > 0)) continue;  // larger values are larger depths, or inverse ones
    const double cost = RobustCost(some, factor, shift);
    if (std::isfinite(cost) && cost < best_cost) {
      best_cost = cost;
      best = {factor, shift};
    }
  }
  if (!std::isfinite(best_cost)) return std::nullopt;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    for (const LineSample& s : samples) {
      const double per_target = s.px / s.target;
      const double error_px = (best.factor * s.value + best.shift - s.target) * per_target;
      const double weight =
          per_target * per_target / (1 + error_px * error_px / (kLossWidthPx * kLossWidthPx));
      const Eigen::Vector2d row(s.value, 1);
      normal += weight * row * row.transpose();
      right += weight * s.target * row;
    }
    constexpr double kLeastRank = 1e-12;
    if (!(normal.determinant() > kLeastRank * normal(0, 0) * normal(1, 1))) break;
    const Eigen::Vector2d solution = normal.inverse() * right;
    if (!solution.allFinite() || !(solution.x() > 0)) break;
    best = {solution.x(), solution.y()};
  }
  return best;
}

double ValueSteps::Bits() const { return std::log2(largest / step + 1); }

double ValueSteps::Nearest(double z) const {
  const double value = of_inverse ? 1 / z : z;
  const double nearest = first + step * std::round((value - first) / step);
  return of_inverse ? 1 / nearest : nearest;
}

std::optional<ValueSteps> FindValueSteps(const DepthMap& map) {
  std::vector<double> known;
  for (const float z : map.z) {
    if (z > 0) known.push_back(static_cast<double>(z));
  }
  const size_t pixels = known.size();
  std::sort(known.begin(), known.end());
  std::vector<double> values;
  for (const double z : known) {
    if (values.empty() || z - values.back() > kSame * z) values.push_back(z);
  }
  if (values.size() < kMinValues || values.size() > pixels / kMinPixelsPerValue) {
    return std::nullopt;
  }
  if (const auto steps = FitSteps(values)) return steps;
  std::reverse(values.begin(), values.end());
  for (double& value : values) value = 1 / value;
  auto steps = FitSteps(values);
  if (steps) steps->of_inverse = true;
  return steps;
}

double FindQuantizationStep(const DepthMap& map) {
  constexpr size_t kMaxSamples = 20000;
  std::vector<float> values;
  const size_t stride = std::max<size_t>(1, map.z.size() / kMaxSamples);
  for (size_t i = 0; i < map.z.size(); i += stride) {
    if (map.z[i] > 0) values.push_back(map.z[i]);
  }
  constexpr size_t kMinPixels = 100;
  if (values.size() < kMinPixels) return 0;
  const size_t samples = values.size();
  std::sort(values.begin(), values.end());
  // Values of one step may differ in their last bits.
  constexpr float kSame = 1e-5F;
  std::vector<float> gaps;
  for (size_t i = 1; i < values.size(); ++i) {
    if (values[i] - values[i - 1] > kSame * values[i]) gaps.push_back(values[i] - values[i - 1]);
  }
  if (gaps.empty() || gaps.size() > samples / 3) return 0;
  std::nth_element(gaps.begin(), gaps.begin() + static_cast<std::ptrdiff_t>(gaps.size() / 4),
                   gaps.end());
  return static_cast<double>(gaps[gaps.size() / 4]);
}

}  // namespace raylift
