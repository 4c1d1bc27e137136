// A depth map: for each pixel the depth of the surface that its center shows.

#pragma once

#include <cstddef>
#include <vector>

namespace raylift {

// z along the optical axis (never the length of the ray, but in a panorama, which has no axis),
// row-major, in scene units; 0 = no surface.
struct DepthMap {
  int width_px = 0;
  int height_px = 0;
  std::vector<float> z;

  float At(int x, int y) const { return z[static_cast<size_t>(y) * width_px + x]; }
};

}  // namespace raylift
