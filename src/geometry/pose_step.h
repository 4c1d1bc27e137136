// The algebra of a pose's steps (w, v), which geometry/residuals.h defines.

#pragma once

#include <Eigen/Core>

#include "raylift/geometry/rigid3.h"

namespace raylift {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

// Returns the pose after a step, which StepBetween() finds again.
inline Rigid3 Moved(const Rigid3& pose, const Vector6d& step) {
  return Rigid3{RotationFromVector(step.head<3>()), step.tail<3>()} * pose;
}

// Returns the adjoint of b_from_a, which turns a step of a's frame into the one of b's frame that
// moves the world alike: [R 0; [t]x R, R].
inline Matrix6d StepAdjoint(const Eigen::Matrix3d& R, const Eigen::Vector3d& t) {
  Matrix6d adjoint = Matrix6d::Zero();
  adjoint.topLeftCorner<3, 3>() = R;
  adjoint.bottomRightCorner<3, 3>() = R;
  adjoint.bottomLeftCorner<3, 3>() = Skew(t) * R;
  return adjoint;
}
inline Matrix6d StepAdjoint(const Rigid3& b_from_a) {
  return StepAdjoint(b_from_a.rotation.toRotationMatrix(), b_from_a.translation);
}

}  // namespace raylift
