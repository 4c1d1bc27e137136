// Colors and normals as 8-bit pictures hold them.

#pragma once

#include <algorithm>
#include <concepts>
#include <cstdint>

namespace raylift {

// The nearest of 0 .. 255, halves upwards; 0 for NaN.
template <std::floating_point T>
uint8_t NearestByte(T value) {
  if (!(value > 0)) return 0;
  const T raised = std::min(value, T{255}) + T{0.5};
  return static_cast<uint8_t>(raised);  // not negative, hence cut off downwards
}

}  // namespace raylift
