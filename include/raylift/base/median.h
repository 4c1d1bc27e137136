// Medians, for robust statistics.

#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace raylift {

// The upper of the middle two for an even count; 0 of none.
inline double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
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
