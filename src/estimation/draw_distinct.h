#pragma once

#include <algorithm>
#include <array>

#include "base/rng.h"

namespace raylift {

// `kCount` different indices in [0, n); n >= kCount.
template <int kCount>
std::array<int, kCount> DrawDistinct(Rng& rng, int n) {
  std::array<int, kCount> indices;
  for (int i = 0; i < kCount;) {
    const int index = static_cast<int>(rng.UniformIndex(static_cast<uint32_t>(n)));
    if (std::find(indices.begin(), indices.begin() + i, index) == indices.begin() + i) {
      indices[i++] = index;
    }
  }
  return indices;
}

}  // namespace raylift
