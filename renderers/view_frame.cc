#include "renderers/view_frame.h"

#include <algorithm>
#include <cmath>

namespace raylift {

PixelRays RaysOf(const ViewCamera& camera, int threads) {
  return camera.lens ? PixelRays(*camera.lens, threads)
                     : PixelRays::Equirectangular(camera.width_px, camera.height_px, threads);
}

Frame RenderScaled(const FrameRenderer& renderer, const View& view, int longer_side_px) {
  const double ratio =
      static_cast<double>(longer_side_px) / std::max(view.camera.width_px, view.camera.height_px);
  const auto scaled = [ratio](int side) {
    return std::max(1, static_cast<int>(std::lround(side * ratio)));
  };
  const ViewCamera camera =
      view.camera.Scaled(scaled(view.camera.width_px), scaled(view.camera.height_px));
  Frame frame;
  renderer.Render(RaysOf(camera, 1), view.cam_from_world, 1, frame);
  return frame;
}

}  // namespace raylift
