#include "raylift/evaluation/calibration.h"

#include <cmath>
#include <vector>

#include "base/statistics.h"
#include <Eigen/Cholesky>

#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

// The 90 % quantile of chi-squared with six degrees of freedom.
constexpr double kChiSquared90 = 10.644640675668422;

}  // namespace

Calibration Calibrate(std::span<const UncertainPose> poses) {
  Calibration calibration;
  std::vector<double> squares, sigmas;
  size_t covered = 0, below_3 = 0;
  double sum = 0;
  for (const UncertainPose& pose : poses) {
    const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> factors(pose.covariance);
    if (factors.info() != Eigen::Success || !factors.isPositive() || !(factors.rcond() > 1e-16)) {
      continue;
    }
    const Vector6d step = StepBetween(pose.true_cam_from_world, pose.estimated_cam_from_world);
    const double squared = step.dot(factors.solve(step));
    if (!std::isfinite(squared)) continue;
    squares.push_back(squared / 6);
    sum += squared / 6;
    covered += squared < kChiSquared90 ? 1 : 0;
    const double error =
        (pose.estimated_cam_from_world.OriginInSource() - pose.true_cam_from_world.OriginInSource())
            .norm();
    sigmas.push_back(error / std::sqrt(pose.covariance.bottomRightCorner<3, 3>().trace()));
    below_3 += sigmas.back() < 3 ? 1 : 0;
  }
  calibration.poses = squares.size();
  if (squares.empty()) return calibration;
  const auto count = static_cast<double>(squares.size());
  calibration.mean_normalized_square = sum / count;
  calibration.coverage_90 = static_cast<double>(covered) / count;
  calibration.share_below_3_sigma = static_cast<double>(below_3) / count;
  calibration.median_normalized_square = UpperMedianOr(std::move(squares), 0);
  calibration.median_sigmas = UpperMedianOr(std::move(sigmas), 0);
  return calibration;
}

}  // namespace raylift
