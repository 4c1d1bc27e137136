// Medians and quantiles, for robust statistics. Two medians of an even count are in use: the upper
// of the middle two, which is one of the values and stays finite as long as half of them are, and
// their midpoint.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "raylift/base/error.h"

namespace raylift {

// The standard deviation of normal values over their median absolute deviation: 1 / Phi^-1(3/4).
inline constexpr double kSigmaPerMad = 1.4826;
// The standard error of the median of normal values over that of their mean: sqrt(pi / 2).
inline constexpr double kMedianErrorPerMeanError = 1.2533;

inline double Percent(size_t part, size_t whole) {
  return whole > 0 ? 100.0 * static_cast<double>(part) / static_cast<double>(whole) : 0;
}

// Returns the value at index share * (count - 1), rounded down, of the values in order. Reorders
// the values, of which there must be one at least.
template <typename T>
T QuantileInPlace(std::span<T> values, double share) {
  RAYLIFT_CHECK(!values.empty());
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// Reorders the values, of which there must be at least one, and returns the upper median.
template <typename T>
T UpperMedianInPlace(std::span<T> values) {
  RAYLIFT_CHECK(!values.empty());
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

inline double UpperMedianOr(std::vector<double> values, double if_none) {
  return values.empty() ? if_none : UpperMedianInPlace(std::span(values));
}

// Returns the upper median of |value - center|; 0 for no values.
inline double UpperDeviation(std::vector<double> values, double center) {
  for (double& value : values) value = std::abs(value - center);
  return UpperMedianOr(std::move(values), 0);
}

// Reorders the values, of which there must be at least one, and returns the midpoint median.
template <typename T>
double MidpointMedianInPlace(std::span<T> values) {
  const auto upper = static_cast<double>(UpperMedianInPlace(values));
  if (values.size() % 2 == 1) return upper;
  const auto below = values.first(values.size() / 2);
  return 0.5 * (static_cast<double>(*std::max_element(below.begin(), below.end())) + upper);
}

struct WeightedValue {
  double value;
  double weight;
};

// Returns the smallest value at which half of the weight is reached; 0 for no values.
inline double WeightedMedian(std::vector<WeightedValue> values) {
  std::sort(values.begin(), values.end(),
            [](const WeightedValue& a, const WeightedValue& b) { return a.value < b.value; });
  double total = 0;
  for (const WeightedValue& v : values) total += v.weight;
  double below = 0;
  for (const WeightedValue& v : values) {
    below += v.weight;
    if (below >= 0.5 * total) return v.value;
  }
  return 0;
}

}  // namespace raylift
