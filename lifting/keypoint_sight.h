// A keypoint of a map, whose depth is in question, as the camera of its match sees it: each depth
// puts it on another place of a line there. Private to lifting.

#pragma once

#include <optional>

#include "geometry/triangulation.h"
#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct KeypointSight {
  SightLine line_in_other;  // ray_t is the depth z in the map

  Eigen::Vector3d PointInOther(double depth_z) const { return line_in_other.At(depth_z); }
};

// None where the pixel has no ray in front of the map's image plane.
std::optional<KeypointSight> SeeFromOther(const PosedImage& map, const Eigen::Vector2d& pixel,
                                          const PosedImage& other);

// The depth at which the keypoint's ray passes closest to its match's ray.
struct TriangulatedDepth {
  double z;
  Eigen::Vector2d projected_px;  // in the other image
  // By how much a unit of log z moves the projection: the more, the better the depth is known.
  double gain_px;
};

// None where it lies behind either camera.
std::optional<TriangulatedDepth> TriangulateDepth(const KeypointSight& sight,
                                                  const Camera& other_camera,
                                                  const Eigen::Vector2d& other_px);

}  // namespace raylift
