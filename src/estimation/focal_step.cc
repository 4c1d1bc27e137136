#include "estimation/focal_step.h"

#include <cmath>

#include <Eigen/Cholesky>

namespace raylift {

std::optional<FocalStep> FocalEquations::Solve(const Matrix6d& cam_from_pose) const {
  // What is left of the curvature is no rounding.
  constexpr double kLeastShare = 1e-9;
  const Eigen::LDLT<Eigen::MatrixXd> factors(hessian);
  if (!factors.isPositive() || !(factors.rcond() > 1e-16)) return std::nullopt;
  const Eigen::VectorXd followed = factors.solve(mixed);
  const double information = curvature - mixed.dot(followed);
  if (!(information > kLeastShare * curvature)) return std::nullopt;
  const FocalStep step = {.log_factor = -(slope - followed.dot(gradient)) / information,
                          .variance = 1 / information,
                          .pose_by_log_factor = -(cam_from_pose * followed.head<6>())};
  if (!std::isfinite(step.log_factor) || !step.pose_by_log_factor.allFinite()) return std::nullopt;
  return step;
}

}  // namespace raylift
