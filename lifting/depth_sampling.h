// Interpolates depth between the pixel centers of a map, as exact as the surface allows and never a
// mixture of two surfaces: a depth map is a set of samples of several surfaces, and a mean of
// foreground and background is on neither.
//
// On a plane 1/z is affine in the pixel, so interpolation is linear in 1/z. Two neighbors belong
// to one surface unless their depths jump: by more than `max_jump` (relative), or by more than a
// fifth of it where neither side's slope leads to the other.

#pragma once

#include <optional>

#include <Eigen/Core>

#include "raylift/lifting/depth_source.h"
#include "raylift/scene/image.h"

namespace raylift {

struct DepthSample {
  double z;
  // d (1/z) / d pixel of the surface; has_gradient tells whether it is known in both directions (it
  // is not where a pixel stands alone).
  Eigen::Vector2d inverse_z_gradient;
  bool has_gradient;
  // The largest relative difference between the depth of a neighboring pixel and that of the
  // surface's plane there; holes do not count.
  double depth_jump;
};

// Returns nullopt outside the map, and where the pixel that the position lies in is a hole.
std::optional<DepthSample> SampleDepth(const DepthMap& map, const Eigen::Vector2d& position_px,
                                       const DepthSamplingOptions& options);

}  // namespace raylift
