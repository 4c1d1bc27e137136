#include "lifting/frame_alignment.h"

#include <cmath>
#include <vector>

#include "support/matchers.h"

#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

// Cameras along a walk, and the same in a frame in which they are `scale` times as far from each
// other, turned and moved.
struct Walk {
  std::vector<Rigid3> in_frame, in_world;

  Walk(int count, double scale, double noise, Rng& rng, double sideways = 1) {
    const Eigen::Quaterniond frame_from_world = RotationFromVector({0.3, -1.2, 0.7});
    for (int i = 0; i < count; ++i) {
      const Eigen::Vector3d center(0.5 * i, sideways * rng.Uniform(-1, 1),
                                   sideways * rng.Uniform(-0.2, 0.2));
      const Eigen::Quaterniond rotation =
          RotationFromVector({0.1 * rng.Uniform(-1, 1), 0.2 * i, 0});
      const Eigen::Vector3d error(rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1));
      in_world.push_back({rotation, -(rotation * center)});
      const Eigen::Vector3d center_in_frame =
          scale * (frame_from_world * (center + noise * error)) + Eigen::Vector3d(3, 2, 1);
      const Eigen::Quaterniond cam_from_frame = rotation * frame_from_world.conjugate();
      in_frame.push_back({cam_from_frame, -(cam_from_frame * center_in_frame)});
    }
  }
};

TEST(AlignFrame, FindsTheScaleOfExactPoses) {
  Rng rng = TestRng();
  for (const double sideways : {1.0, 0.0}) {  // a straight walk leaves the rotation to the cameras
    const Walk walk(12, 0.37, 0, rng, sideways);
    const auto found = AlignFrame(walk.in_frame, walk.in_world);
    ASSERT_TRUE(found);
    EXPECT_NEAR(found->scale, 1 / 0.37, 1e-9);
    EXPECT_EQ(found->num_agreeing, 12u);
    EXPECT_LT(found->relative_sigma, 1e-9);
  }
}

TEST(AlignFrame, TellsHowSureTheScaleIs) {
  Rng rng = TestRng();
  double sum = 0;
  constexpr int kRounds = 40;
  for (int round = 0; round < kRounds; ++round) {
    const Walk walk(30, 2.5, 0.05, rng);
    const auto found = AlignFrame(walk.in_frame, walk.in_world);
    ASSERT_TRUE(found);
    sum += std::pow((found->scale * 2.5 - 1) / found->relative_sigma, 2);
  }
  // The mean of 40 squares of normal values is 1 with a standard deviation of 0.22.
  EXPECT_GT(sum / kRounds, 0.3);
  EXPECT_LT(sum / kRounds, 2);
}

TEST(AlignFrame, AThirdOfWrongPosesDoesNotMatter) {
  Rng rng = TestRng();
  Walk walk(30, 0.5, 0.01, rng);
  for (size_t i = 0; i < 10; ++i) {
    walk.in_frame[3 * i].translation += 4 * Eigen::Vector3d(rng.Uniform(-1, 1), 1, 1);
  }
  for (size_t i = 0; i < 4; ++i) walk.in_frame[3 * i].rotation = walk.in_frame[28].rotation;
  const auto found = AlignFrame(walk.in_frame, walk.in_world);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->num_agreeing, 20u);
  EXPECT_NEAR(found->scale, 2, 0.01);
}

TEST(AlignFrame, HasNoneWhereRotationsAloneAgree) {
  Rng rng = TestRng();
  for (const int count : {10, 30, 100}) {
    Walk walk(count, 0.5, 0, rng);
    for (Rigid3& pose : walk.in_frame) {
      pose.translation = {rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)};
    }
    EXPECT_FALSE(AlignFrame(walk.in_frame, walk.in_world)) << count;
  }
}

TEST(AlignFrame, HasNoneForPosesOfAnotherConventionOnePlaceOrTwoCameras) {
  Rng rng = TestRng();
  Walk walk(12, 0.5, 0, rng);
  std::vector<Rigid3> inverted;
  for (const Rigid3& pose : walk.in_frame) inverted.push_back(pose.Inverse());
  EXPECT_FALSE(AlignFrame(inverted, walk.in_world));
  EXPECT_FALSE(AlignFrame(std::span(walk.in_frame).first(2), std::span(walk.in_world).first(2)));
  EXPECT_FALSE(AlignFrame({}, {}));
  for (Rigid3& pose : walk.in_frame) pose.translation.setZero();
  EXPECT_FALSE(AlignFrame(walk.in_frame, walk.in_world));
}

}  // namespace
}  // namespace raylift
