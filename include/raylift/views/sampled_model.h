// Sampled poses as a COLMAP model, which `render` and everything else reads.

#pragma once

#include <span>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/io/colmap_model.h"

namespace raylift {

// One camera, images "0000.jpg", ... With rig_cameras > 1 each pose is that of a rig of so many
// cameras at one place, turned to the right about the image's vertical by equal angles: images
// "camera0/0000.jpg", ..., and COLMAP's rigs and frames.
ColmapModel MakeSampledModel(const Camera& camera, std::span<const Rigid3> cam_from_world,
                             int rig_cameras);

}  // namespace raylift
