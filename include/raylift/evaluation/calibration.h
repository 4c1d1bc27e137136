// Whether the covariances of poses say how wrong the poses are.

#pragma once

#include <cstddef>
#include <span>

#include <Eigen/Core>

#include "raylift/geometry/rigid3.h"

namespace raylift {

struct UncertainPose {
  Rigid3 estimated_cam_from_world;
  Rigid3 true_cam_from_world;
  // Of the step (w, v) in the camera's tangent frame, as PoseEstimate::covariance.
  Eigen::Matrix<double, 6, 6> covariance;
};

// Of right covariances the mean is 1, the coverage 0.9; where poses are less sure than they say,
// the mean is larger and the coverage smaller. A few poses that are far off rule the mean, not the
// coverage.
struct Calibration {
  size_t poses = 0;
  double mean_normalized_square = 0;  // e' covariance^-1 e / 6
  double median_normalized_square = 0;
  double coverage_90 = 0;          // share of the poses within the ellipsoid of 90 %
  double median_sigmas = 0;        // of the position error over position_sigma
  double share_below_3_sigma = 0;  // of the same
};

// Covariances that are singular are left out.
Calibration Calibrate(std::span<const UncertainPose> poses);

}  // namespace raylift
