#include "value_steps.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace raylift {
namespace {

// Of a continuous map hardly any two pixels agree.
constexpr size_t kMinPixelsPerValue = 3;
constexpr size_t kMinValues = 3;
// The relative precision of values of one step: float, and interpolation between equal ones.
constexpr double kSame = 1e-6;
// By how much of a step a value may miss its own, and how many may miss it by more: interpolation
// between steps gives some.
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

}  // namespace

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

}  // namespace raylift
