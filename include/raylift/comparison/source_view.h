// What a source of geometry shows to a camera, at every pixel center and through the same door as
// the lifter: whatever a source is made of, what is compared is what localization would get.

#pragma once

#include <vector>

#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Row-major, of the size of the image's camera.
struct SourceView {
  DepthMap depth;
  std::vector<float> normals_in_world;  // x, y, z per pixel; 0, 0, 0 = not known
  std::vector<float> incidence_deg;     // -1 = not known
};
SourceView LookThrough(const GeometrySource& source, const PosedImage& image);

// The same view with its longer side at most `max_side_px`.
PosedImage ShrunkTo(const PosedImage& image, int max_side_px);

// The pixel centers of a grid of about `count` cells over an image.
std::vector<Eigen::Vector2d> GridPixels(const Camera& camera, int count);

}  // namespace raylift
