// What the class RayCaster of the module holds.

#pragma once

#include <memory>
#include <mutex>

#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/pixel_rays.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift::python {

// The rays of the camera that was used last: views mostly come from one, and distorted lenses are
// dear to invert. Thread safe.
class LastRays {
 public:
  std::shared_ptr<const PixelRays> Of(const Camera& camera, int threads);

 private:
  std::mutex mutex_;
  Camera camera_;
  std::shared_ptr<const PixelRays> rays_;
};

// The renderer of the options that were used last: textures are filtered once for all views. Thread
// safe.
class LastRenderer {
 public:
  std::shared_ptr<const FrameRenderer> Of(const std::shared_ptr<const RayCaster>& caster,
                                          const FrameOptions& options);

 private:
  std::mutex mutex_;
  FrameOptions options_;
  std::shared_ptr<const FrameRenderer> renderer_;
};

struct Caster {
  explicit Caster(std::shared_ptr<const RayCaster> ray_caster) : caster(std::move(ray_caster)) {}

  std::shared_ptr<const RayCaster> caster;
  LastRays rays;
  LastRenderer renderer;
};

}  // namespace raylift::python
