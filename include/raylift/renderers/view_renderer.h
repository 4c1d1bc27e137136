// What a camera sees of a mesh, one picture at a time: short forms of FrameRenderer.

#pragma once

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/depth_map.h"
#include "raylift/scene/image.h"

namespace raylift {

// z-depth at every pixel center. Same bytes for any number of threads.
DepthMap RenderDepth(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                     int threads);

// RGB from texture (bilinear), else vertex colors, else `untextured_rgb`.
Image RenderColor(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                  const ColorOptions& options, int threads);

}  // namespace raylift
