// Aligns poses in a frame and scale of their own to the world.

#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "raylift/geometry/rigid3.h"

namespace raylift {

// Holds the scale of a similarity, and how well it is known:
//   point_in_world = scale * rotation * point_in_frame + translation
struct FrameAlignment {
  double scale = 1;
  double relative_sigma = 0;  // of the scale
  double position_sigma = 0;  // of the cameras' centers along each axis, scene units
  size_t num_agreeing = 0;    // of the poses
};

// Returns the scale of the similarity that most of the cameras agree with, by their centers and
// rotations: of the hypotheses from pairs of cameras the one of the least median error is taken,
// and refined by least squares over the cameras that agree. nullopt where fewer than three or less
// than half of them do, or where the centers are one place, which has no scale. The result is the
// same for the same input.
std::optional<FrameAlignment> AlignFrame(std::span<const Rigid3> cam_from_frame,
                                         std::span<const Rigid3> cam_from_world);

}  // namespace raylift
