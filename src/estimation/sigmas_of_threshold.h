#pragma once

namespace raylift {

// A threshold is some two and a half standard deviations of the keypoints' noise, and stays so of
// both errors together where a point or a reference is uncertain: t^2 becomes t^2 + (2.5 sigma)^2.
inline constexpr double kSigmasOfThreshold = 2.5;

// The squared residual of one standard deviation over its squared threshold.
inline constexpr double kSquaredSigma = 1 / (kSigmasOfThreshold * kSigmasOfThreshold);

}  // namespace raylift
