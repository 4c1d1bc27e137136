// The rays through all pixel centres of a picture. They depend on the lens alone, so that one table
// serves all views of a camera; what makes a distorted lens dear, its inversion, is done once.

#pragma once

#include <optional>
#include <vector>

#include "raylift/geometry/camera.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {

class PixelRays {
 public:
  PixelRays(const Camera& camera, int threads);

  // A panorama of all directions: column x + 0.5 looks at the azimuth 2 pi ((x + 0.5) / width -
  // 0.5) from z towards x, row y + 0.5 at the elevation pi (0.5 - (y + 0.5) / height), up being -y.
  // Not a camera to localize with.
  static PixelRays Equirectangular(int width_px, int height_px, int threads);

  int width_px() const { return width_px_; }
  int height_px() const { return height_px_; }
  bool is_panorama() const { return !camera_; }

  // The unit ray through the centre of a pixel in the camera's frame, in double.
  std::optional<Eigen::Vector3d> RayInCam(int x, int y) const;

  // The same in float for the pixels (4 bx, 4 by) ... (4 bx + 3, 4 by + 3); no ray (zero length)
  // where the lens has none, and outside the picture.
  const RayBlock& Block(int bx, int by) const {
    return blocks_[static_cast<size_t>(by) * static_cast<size_t>(blocks_per_row_) +
                   static_cast<size_t>(bx)];
  }

  size_t MemoryBytes() const { return blocks_.size() * sizeof(RayBlock); }

 private:
  PixelRays(std::optional<Camera> camera, int width_px, int height_px, int threads);

  std::optional<Camera> camera_;  // none: a panorama
  int width_px_;
  int height_px_;
  int blocks_per_row_;
  std::vector<RayBlock> blocks_;
};

}  // namespace raylift
