// Depth maps of a camera that is not quite the image's, as an uncalibrated depth camera gives them:
// to check that a comparison names what is wrong (depth_explanation.h has the same quantities).

#pragma once

#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/scene/image.h"

namespace raylift {

struct DepthMisalignment {
  Eigen::Vector2d shift_px = Eigen::Vector2d::Zero();  // by which the map lies off
  double zoom = 1;                                     // the map's focal length over the true one
  double lens = 0;                                     // k of c + (p - c) (1 + k (|p - c| / f)^2)
  Eigen::Vector3d rotation_deg = Eigen::Vector3d::Zero();  // of cam_from_map_camera, a vector

  // Throws OptionError for a value out of its range.
  void Validate() const;
  bool IsNone() const;
};

// Returns what the misaligned camera sees of a map that `camera` sees; shift in pixels of the
// camera's size. Applied to a pixel of the result in the order of the fields. Pixels that see what
// the map does not show are holes.
DepthMap MisalignDepth(const DepthMap& map, const Camera& camera,
                       const DepthMisalignment& misalignment);

}  // namespace raylift
