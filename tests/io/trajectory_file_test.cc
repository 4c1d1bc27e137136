#include "io/scene/trajectory_file.h"

#include <cmath>
#include <sstream>

#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

// A camera at (1, 2, 3) that looks along the world's x; up in its image is the world's z.
TimedPose LookingAlongX(double time_s) {
  Eigen::Matrix3d world_from_cam;
  world_from_cam << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  const Rigid3 pose{Eigen::Quaterniond(world_from_cam), {1, 2, 3}};
  return {time_s, pose.Inverse()};
}

std::vector<double> Numbers(const std::string& line) {
  std::istringstream stream(line);
  std::vector<double> numbers;
  for (double number; stream >> number;) numbers.push_back(number);
  return numbers;
}

void ExpectNear(const std::vector<double>& actual, const std::vector<double>& expected) {
  ASSERT_EQ(actual.size(), expected.size());
  for (size_t i = 0; i < actual.size(); ++i) EXPECT_NEAR(actual[i], expected[i], 1e-15) << i;
}

TEST(TrajectoryFile, TumHoldsTheCenterAndTheRotationToTheWorldXFirst) {
  const auto file = TestFolder() / "tum.txt";
  const TimedPose poses[] = {LookingAlongX(1305031102.175304)};
  WriteTumTrajectory(file, poses);
  std::istringstream lines(ReadFile(file));
  std::string comment, line;
  std::getline(lines, comment);
  EXPECT_TRUE(comment.starts_with('#'));
  std::getline(lines, line);
  EXPECT_TRUE(line.starts_with("1305031102.175304 "));
  // x -> -y, y -> -z, z -> x: (x, y, z, w) = (-1, 1, -1, 1) / 2, or the same rotation negated.
  const double half = std::copysign(0.5, Numbers(line).back());
  ExpectNear(Numbers(line), {1305031102.175304, 1, 2, 3, -half, half, -half, half});
}

TEST(TrajectoryFile, KittiHoldsTheMatrixToTheWorldRowByRow) {
  const auto file = TestFolder() / "kitti.txt";
  const TimedPose poses[] = {LookingAlongX(0), LookingAlongX(1)};
  WriteKittiTrajectory(file, poses);
  std::istringstream lines(ReadFile(file));
  std::string line;
  for (int i = 0; i < 2; ++i) {
    ASSERT_TRUE(std::getline(lines, line));
    ExpectNear(Numbers(line), {0, 0, 1, 1, -1, 0, 0, 2, 0, -1, 0, 3});
  }
  EXPECT_FALSE(std::getline(lines, line));
}

}  // namespace
}  // namespace raylift
