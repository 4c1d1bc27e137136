#include <vector>

#include "support/matchers.h"
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/evaluation/perturbation.h"

namespace raylift {
namespace {

// 400 steps of a quarter of a unit.
std::vector<Rigid3> StraightWay() {
  std::vector<Rigid3> poses(401);
  for (size_t i = 0; i < poses.size(); ++i) poses[i].translation.x() = -0.25 * i;
  return poses;
}

TEST(PerturbOdometry, WithoutErrorsItIsTheTrajectorySeenFromItsFirstCamera) {
  Rng rng = TestRng();
  std::vector<Rigid3> truth;
  for (int i = 0; i < 5; ++i) truth.push_back(RandomRigid3(rng, 5));
  const auto poses = PerturbOdometry(truth, {.unit = 2}, 0);
  ASSERT_EQ(poses.size(), 5U);
  for (size_t i = 0; i < 5; ++i) {
    Rigid3 expected = truth[i] * truth[0].Inverse();
    expected.translation /= 2;
    EXPECT_TRUE(IsNearPose(poses[i].cam_from_odometry, expected, 1e-9, 1e-9));
  }
}

TEST(PerturbOdometry, DriftGrowsWithTheRootOfTheWay) {
  const std::vector<Rigid3> truth = StraightWay();
  double sum = 0;
  constexpr int kTimes = 40;
  for (uint64_t seed = 0; seed < kTimes; ++seed) {
    const auto poses = PerturbOdometry(truth, {.drift_sigma = 0.02}, seed);
    sum += (poses.back().cam_from_odometry.translation - truth.back().translation).squaredNorm();
  }
  // Three axes, a hundred units of way; 120 draws tell the variance within 13 %, of which this is
  // three.
  EXPECT_NEAR(sum / kTimes, 3 * 0.02 * 0.02 * 100, 0.4 * 3 * 0.02 * 0.02 * 100);
}

TEST(PerturbOdometry, PosesDropOutAndItIsLost) {
  const std::vector<Rigid3> truth = StraightWay();
  const auto poses = PerturbOdometry(truth, {.lost_share = 0.1, .dropout_share = 0.25}, 7);
  EXPECT_NEAR(static_cast<double>(poses.size()), 300, 30);
  size_t lost = 0;
  for (size_t i = 1; i < poses.size(); ++i) {
    const Rigid3 step = poses[i].cam_from_odometry * poses[i - 1].cam_from_odometry.Inverse();
    lost += AngleBetweenDeg(step.rotation, Eigen::Quaterniond::Identity()) > 1e-6 ? 1 : 0;
  }
  EXPECT_NEAR(static_cast<double>(lost), 40, 18);
}

TEST(PerturbOdometry, RefusesValuesOutOfRange) {
  EXPECT_THROW((OdometryPerturbation{.unit = 0}).Validate(), OptionError);
  EXPECT_THROW((OdometryPerturbation{.dropout_share = 1.5}).Validate(), OptionError);
}

}  // namespace
}  // namespace raylift
