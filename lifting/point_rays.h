// Whether a map of points is told in its camera's axes.

#pragma once

#include <span>

#include <Eigen/Core>

#include "raylift/scene/image.h"

namespace raylift {

// Returns the lesser of the correlations of x/z with the column and of y/z with the row: 1 of
// points before a pinhole camera, whatever its intrinsics, and less through a distorted lens.
// `points` are x, y, z, row by row; 0 where few of them are before the camera.
double AgreementWithRays(std::span<const float> points, PlaneSize size,
                         const Eigen::Matrix<float, 3, 4>& cam_from_points);

}  // namespace raylift
