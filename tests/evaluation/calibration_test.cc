#include <cmath>
#include <vector>

#include "base/rng.h"
#include "support/matchers.h"

#include "raylift/evaluation/pose_errors.h"

namespace raylift {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

// Poses whose errors have `factor` squared times the covariance that they state.
std::vector<UncertainPose> Draw(int count, double factor, Rng& rng) {
  std::vector<UncertainPose> poses;
  for (int i = 0; i < count; ++i) {
    Matrix6d root;
    for (int r = 0; r < 6; ++r) {
      for (int c = 0; c < 6; ++c) root(r, c) = (r < 3 ? 0.001 : 0.02) * rng.Normal();
    }
    Vector6d normal;
    for (int r = 0; r < 6; ++r) normal[r] = rng.Normal();
    const Vector6d step = factor * root * normal;
    const Rigid3 truth{RotationFromVector({rng.Normal(), rng.Normal(), rng.Normal()}),
                       Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal())};
    const Eigen::Quaterniond turn = RotationFromVector(step.head<3>());
    poses.push_back({{turn * truth.rotation, turn * truth.translation + step.tail<3>()},
                     truth,
                     root * root.transpose()});
  }
  return poses;
}

TEST(Calibrate, IsOneWhereCovariancesAreRight) {
  Rng rng = TestRng();
  const Calibration right = Calibrate(Draw(3000, 1, rng));
  EXPECT_EQ(right.poses, 3000u);
  EXPECT_NEAR(right.mean_normalized_square, 1, 0.04);
  EXPECT_NEAR(right.coverage_90, 0.9, 0.02);
  // Of the median of a distance in three dimensions over the root of the summed variances.
  EXPECT_NEAR(right.median_sigmas, 0.85, 0.1);
  EXPECT_GT(right.share_below_3_sigma, 0.99);
  const Calibration too_sure = Calibrate(Draw(3000, 2, rng));
  EXPECT_NEAR(too_sure.mean_normalized_square, 4, 0.2);
  EXPECT_LT(too_sure.coverage_90, 0.5);
}

TEST(Calibrate, LeavesOutSingularCovariances) {
  Rng rng = TestRng();
  std::vector<UncertainPose> poses = Draw(3, 1, rng);
  poses[1].covariance.setZero();
  EXPECT_EQ(Calibrate(poses).poses, 2u);
  EXPECT_EQ(Calibrate({}).poses, 0u);
}

}  // namespace
}  // namespace raylift
