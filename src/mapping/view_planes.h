// Measures planes of the surface that a view sees, pixel by pixel.

#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/lifting/geometry_source.h"
#include "raylift/mapping/fusion.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The plane of the surface about a pixel, in the camera's frame: normal . point = offset for its
// points, and more for points in front of it, on the camera's side.
struct PixelPlane {
  Eigen::Vector3f normal_in_cam;
  float offset;
  float depth = 0;
  float weight = 0;  // 0: nothing is seen
};

struct ViewPlanes {
  PosedImage view;
  std::vector<PixelPlane> planes;  // row by row, of the view's size
  double max_depth = 0;            // 0: nothing is seen at all
};

// Looks through the pixels of a view. Where the depth is rough, planes are fitted to the depth
// about each pixel, as far around as their normals need it. Weights are relative to a standard
// deviation of one `unit`, and fall as the surface is slanted: the deviation is the source's own
// where it knows one, else the noise of the views, and at least half a unit. Pixels beside a jump
// of depth are left out, as they may show neither surface.
ViewPlanes LookForPlanes(const GeometrySource& source, const PosedImage& view,
                         const ViewScale& scale, double unit);

// Measures the scale by a sample of pixels of some 30 views and the views nearest to each.
ViewScale MeasureScale(const GeometrySource& source, std::span<const PosedImage> views,
                       int threads);

}  // namespace raylift
