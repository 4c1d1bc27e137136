#include <algorithm>

#include "estimation/solvers/minimal_solvers.h"
#include "support/matchers.h"
#include <Eigen/Geometry>

namespace raylift {
namespace {

using Eigen::Vector3d;

const std::array<Vector3d, 2> kOneCenter{Vector3d::Zero(), Vector3d::Zero()};

Vector3d VectorWithin(Rng& rng, double extent) {
  const double x = rng.Uniform(-extent, extent);
  const double y = rng.Uniform(-extent, extent);
  return {x, y, rng.Uniform(-extent, extent)};
}

// Two points before a camera.
struct SeenByOne {
  Rigid3 cam_from_world;
  std::array<Vector3d, 2> points;
  std::array<Vector3d, 2> rays;
};

SeenByOne MakeSeen(Rng& rng) {
  SeenByOne seen;
  seen.cam_from_world = RandomRigid3(rng, 10);
  for (int i = 0; i < 2; ++i) {
    const Vector3d in_cam = Vector3d(0, 0, 6) + VectorWithin(rng, 5);
    seen.points[i] = seen.cam_from_world.Inverse() * in_cam;
    seen.rays[i] = in_cam.normalized();
  }
  return seen;
}

double Distance(const CamFromLocal& pose, const Rigid3& truth) {
  return std::max((pose.rotation - truth.rotation.toRotationMatrix()).norm(),
                  (pose.translation - truth.translation).norm());
}

TEST(P2p, OfAKnownCenterIsExact) {
  Rng rng = TestRng();
  for (int i = 0; i < 1000; ++i) {
    const SeenByOne seen = MakeSeen(rng);
    const auto pose =
        SolvePoseAtCenter(seen.rays, seen.points, seen.cam_from_world.OriginInSource());
    ASSERT_TRUE(pose);
    EXPECT_LT(Distance(*pose, seen.cam_from_world), 1e-8);
  }
}

TEST(P2p, OfAKnownVerticalIsExact) {
  Rng rng = TestRng();
  for (int i = 0; i < 1000; ++i) {
    const SeenByOne seen = MakeSeen(rng);
    const Vector3d down = VectorWithin(rng, 1).normalized();
    std::array<CamFromLocal, 2> poses;
    const int count = SolveUprightPose(kOneCenter, seen.rays, seen.points,
                                       seen.cam_from_world.rotation * down, down, poses);
    ASSERT_GE(count, 1);
    double nearest = 1e9;
    for (int k = 0; k < count; ++k) {
      nearest = std::min(nearest, Distance(poses[k], seen.cam_from_world));
      // Each puts the points onto their rays, and the vertical where it is.
      for (int p = 0; p < 2; ++p) {
        const Vector3d in_cam = poses[k].rotation * seen.points[p] + poses[k].translation;
        EXPECT_LT((in_cam.normalized() - seen.rays[p]).norm(), 1e-6);
      }
      EXPECT_LT((poses[k].rotation * down - seen.cam_from_world.rotation * down).norm(), 1e-9);
    }
    EXPECT_LT(nearest, 1e-5);
  }
}

// As the first, the points seen by cameras elsewhere in a rig.
TEST(P2p, OfAKnownVerticalIsExactForTwoCameras) {
  Rng rng = TestRng();
  for (int i = 0; i < 1000; ++i) {
    SeenByOne seen = MakeSeen(rng);
    std::array<Vector3d, 2> centers;
    for (int k = 0; k < 2; ++k) {
      centers[k] = VectorWithin(rng, 1);
      seen.rays[k] = (seen.cam_from_world * seen.points[k] - centers[k]).normalized();
    }
    const Vector3d down = VectorWithin(rng, 1).normalized();
    std::array<CamFromLocal, 2> poses;
    const int count = SolveUprightPose(centers, seen.rays, seen.points,
                                       seen.cam_from_world.rotation * down, down, poses);
    double nearest = 1e9;
    for (int k = 0; k < count; ++k) {
      nearest = std::min(nearest, Distance(poses[k], seen.cam_from_world));
    }
    EXPECT_LT(nearest, 1e-5);
  }
}

TEST(P2p, DegenerateSamplesGiveNone) {
  const Vector3d forward = Vector3d::UnitZ();
  const Vector3d down = Vector3d::UnitY();
  const Vector3d center = Vector3d::Zero();
  const std::array<Vector3d, 2> points{{{0, 0, 5}, {1, 0, 5}}};
  EXPECT_FALSE(SolvePoseAtCenter({forward, forward}, points, center));
  EXPECT_FALSE(
      SolvePoseAtCenter({forward, points[1].normalized()}, {points[0], points[0]}, center));
  EXPECT_FALSE(SolvePoseAtCenter({forward, points[1].normalized()}, points, points[0]));
  std::array<CamFromLocal, 2> poses;
  // Both rays level; one point above the other.
  EXPECT_EQ(
      SolveUprightPose(kOneCenter, {forward, points[1].normalized()}, points, down, down, poses),
      0);
  EXPECT_EQ(SolveUprightPose(kOneCenter, {forward, Vector3d(0, 1, 5).normalized()},
                             {Vector3d(0, 0, 5), Vector3d(0, 1, 5)}, down, down, poses),
            0);
}

}  // namespace
}  // namespace raylift
