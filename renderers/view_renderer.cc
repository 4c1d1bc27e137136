#include "raylift/renderers/view_renderer.h"

namespace raylift {
namespace {

Frame RenderOne(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                const FrameOptions& options, int threads) {
  // The caster outlives the renderer, which is gone when this returns.
  const std::shared_ptr<const RayCaster> borrowed(std::shared_ptr<void>(), &caster);
  Frame frame;
  FrameRenderer(borrowed, options)
      .Render(PixelRays(camera, threads), cam_from_world, threads, frame);
  return frame;
}

}  // namespace

DepthMap RenderDepth(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                     int threads) {
  FrameOptions options;
  options.depth = true;
  Frame frame = RenderOne(caster, camera, cam_from_world, options, threads);
  return {frame.width_px, frame.height_px, std::move(frame.depth)};
}

Image RenderColor(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                  const ColorOptions& options, int threads) {
  FrameOptions frame_options;
  frame_options.color = true;
  frame_options.color_options = options;
  return std::move(RenderOne(caster, camera, cam_from_world, frame_options, threads).color);
}

}  // namespace raylift
