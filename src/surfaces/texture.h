// Samples a picture on a surface: bilinear between texels, and between halved copies where a pixel
// covers many texels.

#pragma once

#include <vector>

#include <Eigen/Core>

#include "raylift/scene/image.h"

namespace raylift {

class Texture {
 public:
  // `image` is RGB and must outlive the texture.
  explicit Texture(const Image& image);

  // Returns RGB in 0..255 at (u, v), v = 0 at the last row; the picture repeats outside [0, 1].
  // `level` is the base-2 logarithm of the texels per pixel side; below 0 counts as 0.
  Eigen::Vector3f Sample(const Eigen::Vector2f& uv, double level) const;

  double NumTexels() const {
    return static_cast<double>(image_->width_px) * static_cast<double>(image_->height_px);
  }

 private:
  const Image& Level(size_t level) const { return level == 0 ? *image_ : halved_[level - 1]; }

  const Image* image_;
  std::vector<Image> halved_;
};

}  // namespace raylift
