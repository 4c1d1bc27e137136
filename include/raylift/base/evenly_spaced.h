// Some of many that stand in an order, for where only so many can be looked at, and neighbors are
// alike.

#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace raylift {

// At most `most` of the indices 0, ..., count - 1, ascending and evenly spaced from 0 on.
inline std::vector<size_t> EvenlySpaced(size_t count, size_t most) {
  std::vector<size_t> chosen(std::min(count, most));
  for (size_t i = 0; i < chosen.size(); ++i) chosen[i] = i * count / chosen.size();
  return chosen;
}

}  // namespace raylift
