// Finds pieces of a rendering in a photograph that was taken from nearly the same pose. Where a
// mesh is coarse, a descriptor has few keypoints that are where the photograph's are; a piece of
// the rendering has all that both show, and its place is known to a fraction of a pixel.

#pragma once

#include <vector>

#include <Eigen/Core>

#include "raylift/scene/image.h"

namespace raylift {

struct PatchMatch {
  Eigen::Vector2d rendering_px;
  Eigen::Vector2d photograph_px;
};

// Returns the rendering's corners, the best first, whose patch is a peak of normalized
// cross-correlation in the photograph. Both are gray, and the photograph is shrunk to the
// rendering's size where it is larger; `mask` is 0 where the rendering shows nothing, and no patch
// holds such a pixel.
std::vector<PatchMatch> AlignPatches(const Image& photograph, const Image& rendering,
                                     const Image& mask);

}  // namespace raylift
