// What the evidence says of the query's focal length at a refined pose, all else following it.

#pragma once

#include <optional>

#include "estimation/normal_equations.h"
#include <Eigen/Core>

namespace raylift {

struct FocalStep {
  double log_factor;            // Newton's step of the focal length's logarithm
  double variance;              // of that logarithm
  Vector6d pose_by_log_factor;  // the pose's step (w, v) in the camera's tangent frame, local units
};

// Normal equations of more unknowns than the focal length, the pose's first: half of the cost's
// gradient and second derivatives.
struct FocalEquations {
  Eigen::MatrixXd hessian;
  Eigen::VectorXd gradient;
  // With the logarithm of the focal length.
  Eigen::VectorXd mixed;
  double slope = 0;
  double curvature = 0;

  // None where the focal length is not determined. `cam_from_pose` takes the first six unknowns to
  // the camera's tangent frame.
  std::optional<FocalStep> Solve(const Matrix6d& cam_from_pose = Matrix6d::Identity()) const;
};

}  // namespace raylift
