// Views of a source of geometry, at every pixel center and through the same door as
// the lifter: whatever a source is made of, what is compared is what localization would get.

#pragma once

#include <vector>

#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Looks at the middle pixel of every `stride` x `stride`, where maps of the image's size hold
// values of their own: the view is that of Sparse().
SourceView LookThrough(const GeometrySource& source, const PosedImage& image, int stride = 1);

// Returns the view whose pixels are those that LookThrough() looks at; of a panorama, within half
// of one.
PosedImage Sparse(const PosedImage& image, int stride);

// Returns the same view with its longer side at most `max_side_px`.
PosedImage ShrunkTo(const PosedImage& image, int max_side_px);

// Returns the pixel centers of a grid of about `count` cells over an image.
std::vector<Eigen::Vector2d> GridPixels(const Camera& camera, int count);

// Returns the middles of the cells of so many columns and rows, row by row.
std::vector<Eigen::Vector2d> PixelGrid(const Camera& camera, int columns, int rows);

}  // namespace raylift
