// Numbers that many files use.

#pragma once

#include <limits>
#include <numbers>

namespace raylift {

inline constexpr double kRadPerDeg = std::numbers::pi / 180;
inline constexpr double kDegPerRad = 180 / std::numbers::pi;
inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace raylift
