// An image in n x n equal parts, to tell what lies together from what is spread over it.

#pragma once

#include <algorithm>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"

namespace raylift {

// Below parts_per_side^2, row by row; pixels outside of the image are in the nearest part.
inline int PartOfImage(const Camera& camera, const Eigen::Vector2d& pixel, int parts_per_side) {
  const auto along = [&](double at, int size) {
    return static_cast<int>(std::clamp(at / size * parts_per_side, 0.0, parts_per_side - 1.0));
  };
  return along(pixel.y(), camera.height_px()) * parts_per_side +
         along(pixel.x(), camera.width_px());
}

}  // namespace raylift
