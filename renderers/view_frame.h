// The frame of a view: a perspective image or a panorama.

#pragma once

#include <algorithm>
#include <cmath>

#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/pixel_rays.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Renders a view with a longer side of so many pixels, on one thread.
inline Frame RenderScaled(const FrameRenderer& renderer, const PosedImage& view,
                          int longer_side_px) {
  const double ratio = static_cast<double>(longer_side_px) /
                       std::max(view.camera.width_px(), view.camera.height_px());
  const auto scaled = [ratio](int side) {
    return std::max(1, static_cast<int>(std::lround(side * ratio)));
  };
  const Camera camera =
      view.camera.Scaled(scaled(view.camera.width_px()), scaled(view.camera.height_px()));
  Frame frame;
  renderer.Render(PixelRays(camera, 1), view.cam_from_world, 1, frame);
  return frame;
}

}  // namespace raylift
