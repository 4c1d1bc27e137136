// Floats as formats of 16 bits hold them: float16, and whole steps. Plain loops over lanes,
// compiled for several instruction sets; all give the same bits.

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "raylift/io/depth_file.h"

namespace raylift {

inline constexpr float kMaxHalf = 65504;

// The bits of the nearest float16 of each value, ties to even. Infinite and NaN stay what they are;
// finite values beyond kMaxHalf, which float16 cannot hold, become 0 and are counted as dropped, as
// are those that round to 0. Returns how many were beyond.
size_t RoundToHalf(std::span<const float> values, std::span<uint16_t> halves,
                   DepthWriteReport& report);

// The nearest whole number of steps, halves upwards. What is not in 0 .. 65535 steps becomes 0 and
// is counted as dropped, as are values that round to 0. Returns how many were beyond. `step` > 0.
size_t RoundToSteps(std::span<const float> values, double step, std::span<uint16_t> counts,
                    DepthWriteReport& report);

}  // namespace raylift
