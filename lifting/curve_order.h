// An order of pixels in which neighbors follow each other: rays through them then meet the same
// parts of a mesh, which are still in the cache, and can be cast in blocks. Private to lifting.

#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"

namespace raylift {

// The pixels' indices along a Z-shaped curve through the cells of a grid over the image, in the
// given order within a cell. Pixels outside count as at the border.
std::vector<uint32_t> OrderAlongCurve(const Camera& camera,
                                      std::span<const Eigen::Vector2d> pixels);

}  // namespace raylift
