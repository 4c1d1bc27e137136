#include <cmath>
#include <vector>

#include "support/matchers.h"
#include <gtest/gtest.h>

#include "raylift/evaluation/pose_errors.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

TEST(TrajectoryErrors, StatisticsAreThoseOfThePopulation) {
  const ErrorStatistics s = StatisticsOf({4, 1, 3, 2});
  EXPECT_DOUBLE_EQ(s.mean, 2.5);
  EXPECT_DOUBLE_EQ(s.median, 2.5);
  EXPECT_DOUBLE_EQ(s.sse, 30);
  EXPECT_DOUBLE_EQ(s.rmse, std::sqrt(7.5));
  EXPECT_DOUBLE_EQ(s.std, std::sqrt(1.25));
  EXPECT_DOUBLE_EQ(s.min, 1);
  EXPECT_DOUBLE_EQ(s.max, 4);
  EXPECT_EQ(StatisticsOf({}).max, 0);
}

// A shift of the world moves every pose and no step; a step that is too long moves one step.
TEST(TrajectoryErrors, AreOfPosesAndOfSteps) {
  Rng rng = TestRng();
  std::vector<TrajectoryPose> poses;
  const Rigid3 moved_from_world{RotationFromVector(Vector3d(0, 0, 0.1)), Vector3d(3, 4, 0)};
  for (int i = 0; i < 6; ++i) {
    const Rigid3 truth = RandomRigid3(rng, 5);
    const double along = i < 3 ? 0 : 0.25;
    const Rigid3 wrong{Eigen::Quaterniond::Identity(), Vector3d(-along, 0, 0)};
    poses.push_back({truth * wrong * moved_from_world, truth});
  }
  const TrajectoryErrors errors = CompareTrajectories("a", poses);
  EXPECT_EQ(errors.poses, 6U);
  EXPECT_NEAR(errors.ape_rotation_deg.min, 0.1 * 180 / M_PI, 1e-9);
  EXPECT_NEAR(errors.rpe_rotation_deg.max, 0, 1e-9);
  EXPECT_NEAR(errors.rpe_position.max, 0.25, 1e-9);
  EXPECT_NEAR(errors.rpe_position.sse, 0.0625, 1e-9);
  EXPECT_NE(FormatTrajectoryText({&errors, 1}).find("rpe_position"), std::string::npos);
}

}  // namespace
}  // namespace raylift
