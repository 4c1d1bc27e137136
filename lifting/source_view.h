// Views of a source of geometry, at every pixel center and through the same door as
// the lifter: whatever a source is made of, what is compared is what localization would get.

#pragma once

#include <vector>

#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

SourceView LookThrough(const GeometrySource& source, const PosedImage& image);

// Returns the same view with its longer side at most `max_side_px`.
PosedImage ShrunkTo(const PosedImage& image, int max_side_px);

// Returns the pixel centers of a grid of about `count` cells over an image.
std::vector<Eigen::Vector2d> GridPixels(const Camera& camera, int count);

}  // namespace raylift
