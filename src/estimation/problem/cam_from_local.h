// A pose in the frame of a NormalizedProblem, and the normal equations of a step from it.
//
// Poses change on the left, in the camera's tangent frame, as in geometry/residuals.h: a step
// (w, v) turns [R t] into [exp(w) R, exp(w) t + v], v in local units.

#pragma once

#include <Eigen/Core>

namespace raylift {

// Takes points to the camera's frame: x_cam = rotation * x_local + translation. The minimal solvers
// return it, too: their local frame is that of the points that they are given.
struct CamFromLocal {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
};

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

// The cost at a pose and, for a step from it, half of the cost's gradient and the Gauss-Newton
// matrix of the same scale.
struct NormalEquations {
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double cost = 0;
};

}  // namespace raylift
