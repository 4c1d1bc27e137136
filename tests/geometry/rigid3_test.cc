#include "raylift/geometry/rigid3.h"

#include <cmath>
#include <limits>
#include <numbers>

#include "support/enum_names.h"
#include "support/matchers.h"
#include <Eigen/LU>

namespace raylift {
namespace {

using Eigen::Vector3d;

Vector3d RandomPoint(Rng& rng) { return {rng.Normal(), rng.Normal(), rng.Normal()}; }

TEST(Rigid3, ProductsChain) {
  Rng rng = TestRng();
  for (int i = 0; i < 100; ++i) {
    const Rigid3 a_from_b = RandomRigid3(rng, 5);
    const Rigid3 b_from_c = RandomRigid3(rng, 5);
    const Vector3d point = RandomPoint(rng);
    EXPECT_LT(((a_from_b * b_from_c) * point - a_from_b * (b_from_c * point)).norm(), 1e-13);
  }
}

TEST(Rigid3, InverseUndoes) {
  Rng rng = TestRng();
  for (int i = 0; i < 100; ++i) {
    const Rigid3 a_from_b = RandomRigid3(rng, 5);
    const Vector3d point = RandomPoint(rng);
    EXPECT_LT((a_from_b.Inverse() * (a_from_b * point) - point).norm(), 1e-13);
    EXPECT_TRUE(IsNearPose(a_from_b * a_from_b.Inverse(), Rigid3(), 1e-12, 1e-13));
  }
}

TEST(Rigid3, OriginInSourceMapsToZero) {
  Rng rng = TestRng();
  const Rigid3 cam_from_world = RandomRigid3(rng, 5);
  EXPECT_LT((cam_from_world * cam_from_world.OriginInSource()).norm(), 1e-14);
}

TEST(Rigid3, ActsAsItsMatrix) {
  const Rigid3 pose = {Eigen::Quaterniond(std::sqrt(0.5), 0, 0, std::sqrt(0.5)), {1, 2, 3}};
  EXPECT_LT((pose * Vector3d(1, 0, 0) - Vector3d(1, 3, 3)).norm(), 1e-15);
}

TEST(Rigid3, KnowsNonFiniteNumbers) {
  Rigid3 pose;
  EXPECT_TRUE(pose.IsFinite());
  pose.translation.y() = std::nan("");
  EXPECT_FALSE(pose.IsFinite());
  pose = Rigid3();
  pose.rotation.w() = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(pose.IsFinite());
}

TEST(RotationFromVector, IsTheAngleAboutTheAxis) {
  Rng rng = TestRng();
  for (const double angle : {0.0, 1e-300, 1e-12, 1e-7, 1.1e-5, 0.9e-5, 1e-3, 1.0, 3.14, 6.0}) {
    const Vector3d axis = RandomPoint(rng).normalized();
    const Eigen::Matrix3d expected = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
    EXPECT_LT((RotationFromVector(angle * axis).toRotationMatrix() - expected).norm(), 2e-15)
        << angle;
  }
}

TEST(RotationFromVector, MovesPointsByTheCrossProductToFirstOrder) {
  Rng rng = TestRng();
  const Vector3d step = 1e-6 * RandomPoint(rng).normalized();
  const Vector3d point = RandomPoint(rng);
  EXPECT_LT((RotationFromVector(step) * point - point - step.cross(point)).norm(), 1e-11);
  EXPECT_LT((Skew(step) * point - step.cross(point)).norm(), 1e-20);
}

TEST(AngleBetweenDeg, IsExactForTinyAndLargeAngles) {
  Rng rng = TestRng();
  for (const double deg : {0.0, 1e-13, 1e-8, 1e-3, 1.0, 90.0, 179.999, 180.0}) {
    const Eigen::Quaterniond a = RandomRigid3(rng, 1).rotation;
    const Vector3d axis = RandomPoint(rng).normalized();
    const Eigen::Quaterniond b = a * RotationFromVector(deg * std::numbers::pi / 180 * axis);
    const Eigen::Quaterniond minus_b(-b.coeffs());
    // Rounding of the quaternions: about 1e-16 rad, 6e-15 deg each.
    EXPECT_NEAR(AngleBetweenDeg(a, b), deg, 5e-14);
    EXPECT_NEAR(AngleBetweenDeg(a, minus_b), deg, 5e-14);
    EXPECT_NEAR(AngleBetweenDeg(b, a), deg, 5e-14);
  }
}

TEST(PoseConvention, StoredPosesComeBack) {
  Rng rng = TestRng();
  const Rigid3 pose = RandomRigid3(rng, 5);
  using enum PoseConvention;
  for (const auto convention :
       {kCamFromWorld, kWorldFromCam, kOpenGlCamFromWorld, kWorldFromOpenGlCamera}) {
    const Rigid3 stored = StoredPose(pose, convention);
    EXPECT_TRUE(IsNearPose(CamFromWorld(stored, convention), pose, 1e-9, 1e-9));
  }
  // OpenGL's camera looks along -z, its y is up.
  const Rigid3 gl = StoredPose({}, kOpenGlCamFromWorld);
  EXPECT_LT((gl * Eigen::Vector3d(1, 2, 3) - Eigen::Vector3d(1, -2, -3)).norm(), 1e-12);
}

TEST(PoseConvention, EachHasAName) { EXPECT_TRUE(NamesEveryValue<PoseConvention>()); }

}  // namespace
}  // namespace raylift
