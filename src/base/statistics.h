// Medians, for robust statistics. Of an even count there are two in use: the upper of the middle
// two, which is one of the values and stays finite as long as half of them are, and their midpoint.

#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "raylift/base/error.h"

namespace raylift {

// The values are reordered; at least one.
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

// The values are reordered; at least one.
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

// The smallest value at which half of the weight is reached; 0 of none.
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
