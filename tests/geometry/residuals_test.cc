#include "raylift/geometry/residuals.h"

#include <cmath>
#include <functional>

#include "geometry/pose_step.h"
#include "geometry/test_cameras.h"
#include "support/matchers.h"
#include <Eigen/LU>

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

Eigen::Matrix<double, Eigen::Dynamic, 6> CentralDifferences(
    const Rigid3& pose, const std::function<Eigen::VectorXd(const Rigid3&)>& error) {
  constexpr double kStep = 1e-6;
  Eigen::Matrix<double, Eigen::Dynamic, 6> jacobian(error(pose).size(), 6);
  for (int i = 0; i < 6; ++i) {
    const Vector6d step = kStep * Vector6d::Unit(i);
    jacobian.col(i) = (error(Moved(pose, step)) - error(Moved(pose, -step))) / (2 * kStep);
  }
  return jacobian;
}

Vector2d RandomPixel(Rng& rng, const Camera& camera) {
  return {rng.Uniform(0, camera.width_px()), rng.Uniform(0, camera.height_px())};
}

// A point seen at a random pixel of a view.
Vector3d RandomVisiblePoint(Rng& rng, const Camera& camera, const Rigid3& cam_from_world) {
  const Vector3d ray = camera.RayInCam(RandomPixel(rng, camera)).value();
  return cam_from_world.Inverse() * (rng.Uniform(2, 6) * ray);
}

TEST(StepBetween, TurnsOnePoseIntoTheOther) {
  Rng rng = TestRng();
  for (int i = 0; i < 20; ++i) {
    const Rigid3 from = RandomRigid3(rng, 2);
    const Rigid3 to = RandomRigid3(rng, 2);
    const Vector6d step = StepBetween(from, to);
    const Rigid3 reached = Moved(from, step);
    EXPECT_LT((reached.translation - to.translation).norm(), 1e-12);
    EXPECT_LT(reached.rotation.angularDistance(to.rotation), 1e-12);
    EXPECT_LE(step.head<3>().norm(), std::acos(-1) + 1e-12);
  }
  const Rigid3 same = RandomRigid3(rng, 2);
  EXPECT_LT(StepBetween(same, same).norm(), 1e-12);
}

class EveryCameraResidual : public ::testing::TestWithParam<TestCamera> {
 protected:
  const Camera& camera() const { return GetParam().camera; }
};

INSTANTIATE_TEST_SUITE_P(Models, EveryCameraResidual, ::testing::ValuesIn(TypicalCameras()),
                         [](const auto& test) { return test.param.name; });

TEST_P(EveryCameraResidual, ReprojectionErrorIsProjectedMinusObserved) {
  Rng rng = TestRng();
  const Rigid3 pose = RandomRigid3(rng, 2);
  const Vector3d point = RandomVisiblePoint(rng, camera(), pose);
  const Vector2d pixel = camera().ImgFromCam(pose * point).value();
  const auto residual = ReprojectionError(camera(), pose, point, pixel - Vector2d(3, -4));
  ASSERT_TRUE(residual);
  EXPECT_LT((residual->error_px - Vector2d(3, -4)).norm(), 1e-12);
}

TEST_P(EveryCameraResidual, ReprojectionJacobianMatchesCentralDifferences) {
  Rng rng = TestRng();
  for (int i = 0; i < 100; ++i) {
    const Rigid3 pose = RandomRigid3(rng, 2);
    const Vector3d point = RandomVisiblePoint(rng, camera(), pose);
    const Vector2d observed = RandomPixel(rng, camera());
    const auto residual = ReprojectionError(camera(), pose, point, observed);
    ASSERT_TRUE(residual);
    const auto differences = CentralDifferences(pose, [&](const Rigid3& moved) -> Eigen::VectorXd {
      return ReprojectionError(camera(), moved, point, observed).value().error_px;
    });
    EXPECT_LT((residual->jacobian - differences).norm(), 1e-7 * residual->jacobian.norm());
  }
}

TEST_P(EveryCameraResidual, SampsonErrorOfATrueMatchVanishes) {
  Rng rng = TestRng();
  const Camera reference = TypicalCameras()[1].camera;
  int tested = 0;
  for (int i = 0; i < 500; ++i) {
    const Rigid3 query_from_world = RandomRigid3(rng, 1);
    const Rigid3 reference_from_world = RandomRigid3(rng, 1);
    const Vector3d point = RandomVisiblePoint(rng, camera(), query_from_world);
    const auto query_px = camera().ImgFromCam(query_from_world * point);
    const auto reference_px = reference.ImgFromCam(reference_from_world * point);
    if (!query_px || !reference_px) continue;
    ++tested;
    const auto residual = SampsonError(camera(), query_from_world, *query_px, reference,
                                       reference_from_world, *reference_px);
    ASSERT_TRUE(residual);
    EXPECT_NEAR(residual->error_px, 0, 1e-7);
  }
  EXPECT_GT(tested, 20);
}

TEST_P(EveryCameraResidual, SampsonJacobianMatchesCentralDifferences) {
  Rng rng = TestRng();
  for (const TestCamera& reference : TypicalCameras()) {
    const Rigid3 query_from_world = RandomRigid3(rng, 1);
    const Rigid3 reference_from_world = RandomRigid3(rng, 1);
    // Any two pixels: the value is exact far from the constraint, too.
    const Vector2d query_px = RandomPixel(rng, camera());
    const Vector2d reference_px = RandomPixel(rng, reference.camera);
    const auto error = [&](const Rigid3& pose) {
      return SampsonError(camera(), pose, query_px, reference.camera, reference_from_world,
                          reference_px)
          .value();
    };
    const auto residual = error(query_from_world);
    const auto differences =
        CentralDifferences(query_from_world, [&](const Rigid3& pose) -> Eigen::VectorXd {
          return Eigen::VectorXd::Constant(1, error(pose).error_px);
        });
    EXPECT_LT((residual.jacobian - differences).norm(), 1e-6 * (1 + residual.jacobian.norm()))
        << reference.name;
  }
}

// The Sampson error is the first-order distance, in the four pixel coordinates, to the nearest
// match that satisfies the epipolar constraint; for small errors that distance is found by moving
// along the constraint's numerical gradient.
TEST_P(EveryCameraResidual, SampsonErrorIsThePixelDistanceToTheConstraint) {
  Rng rng = TestRng();
  const Camera reference = TypicalCameras()[5].camera;
  int tested = 0;
  for (int i = 0; i < 500; ++i) {
    const Rigid3 query_from_world = RandomRigid3(rng, 1);
    const Rigid3 reference_from_world = RandomRigid3(rng, 1);
    const Vector3d point = RandomVisiblePoint(rng, camera(), query_from_world);
    const auto query_px = camera().ImgFromCam(query_from_world * point);
    const auto reference_px = reference.ImgFromCam(reference_from_world * point);
    if (!query_px || !reference_px || !reference.Contains(*reference_px)) continue;
    ++tested;
    // The angle between the reference's ray and the query ray's epipolar plane.
    const Rigid3 query_from_reference = query_from_world * reference_from_world.Inverse();
    const auto constraint = [&](const Eigen::Vector4d& match) {
      const Vector3d q = camera().RayInCam(match.head<2>()).value();
      const Vector3d r = reference.RayInCam(match.tail<2>()).value();
      return q.dot(query_from_reference.translation.cross(query_from_reference.rotation * r));
    };
    Eigen::Vector4d match;
    match << *query_px, *reference_px;
    Eigen::Vector4d gradient;
    for (int k = 0; k < 4; ++k) {
      const Eigen::Vector4d step = 1e-4 * Eigen::Vector4d::Unit(k);
      gradient(k) = (constraint(match + step) - constraint(match - step)) / 2e-4;
    }
    const Eigen::Vector4d away = gradient.normalized();
    const double distance_px = 1e-3;
    const Eigen::Vector4d disturbed = match + distance_px * away;
    const auto residual = SampsonError(camera(), query_from_world, disturbed.head<2>(), reference,
                                       reference_from_world, disturbed.tail<2>());
    ASSERT_TRUE(residual);
    EXPECT_NEAR(std::abs(residual->error_px), distance_px, 2e-3 * distance_px);
  }
  EXPECT_GT(tested, 10);
}

TEST_P(EveryCameraResidual, PixelFrameIsItsInverse) {
  Rng rng = TestRng();
  for (int i = 0; i < 100; ++i) {
    const auto frame = MakePixelFrame(camera(), RandomPixel(rng, camera()));
    ASSERT_TRUE(frame);
    EXPECT_LT((frame->image_from_ray * frame->ray_from_image - Matrix3d::Identity()).norm(), 1e-11);
    EXPECT_LT((frame->ray_from_image * frame->image_from_ray - Matrix3d::Identity()).norm(), 1e-11);
  }
}

TEST_P(EveryCameraResidual, PixelFrameIsExactToFirstOrder) {
  Rng rng = TestRng();
  for (int i = 0; i < 100; ++i) {
    const Vector2d pixel = RandomPixel(rng, camera());
    const auto frame = MakePixelFrame(camera(), pixel).value();
    const Vector3d ray = camera().RayInCam(pixel).value();
    EXPECT_LT((frame.ray_from_image.col(2).normalized() - ray).norm(), 1e-15);
    const Vector2d offset = 1e-3 * Vector2d(rng.Normal(), rng.Normal());
    const Vector3d nearby = 3 * camera().RayInCam(pixel + offset).value();
    const Vector3d image = frame.image_from_ray * nearby;
    EXPECT_GT(image.z(), 0);
    EXPECT_LT((image.head<2>() / image.z() - offset).norm(), 1e-6);
    const Vector3d back = frame.ray_from_image * offset.homogeneous();
    // Second order: (1e-3 px / focal length)^2 times a few.
    EXPECT_LT((back.normalized() - nearby.normalized()).norm(), 1e-8);
  }
}

TEST(PixelFrame, IsExactForAPinholeAtAnyDistance) {
  const Camera camera = TypicalCameras()[1].camera;
  Rng rng = TestRng();
  for (int i = 0; i < 100; ++i) {
    const Vector2d pixel = RandomPixel(rng, camera);
    const Vector3d point = 4 * camera.RayInCam(RandomPixel(rng, camera)).value();
    const Vector3d image = MakePixelFrame(camera, pixel)->image_from_ray * point;
    const Vector2d expected = camera.ImgFromCam(point).value() - pixel;
    EXPECT_LT((image.head<2>() / image.z() - expected).norm(), 1e-11);
  }
}

TEST(PixelFrame, HoldsBeyondNinetyDegrees) {
  const std::vector<double> params = {100, 320, 320};
  const Camera camera(CameraModel::kSimpleFisheye, 640, 640, params);
  for (const double radius_px : {0., 100., 139., 140., 157., 200., 300.}) {
    const Vector2d pixel(320 + radius_px, 320);
    const auto frame = MakePixelFrame(camera, pixel);
    ASSERT_TRUE(frame) << radius_px;
    const Vector3d nearby = camera.RayInCam(pixel + Vector2d(1e-3, 1e-3)).value();
    const Vector3d image = frame->image_from_ray * nearby;
    EXPECT_GT(image.z(), 0) << radius_px;
    EXPECT_LT((image.head<2>() / image.z() - Vector2d(1e-3, 1e-3)).norm(), 1e-7) << radius_px;
  }
  EXPECT_FALSE(MakePixelFrame(camera, {320 + 320, 320}));
}

// Hartley and Zisserman, eq. 11.9, with the fundamental matrix.
TEST(SampsonError, IsTheTextbooksForPinholes) {
  Rng rng = TestRng();
  const Camera query = TypicalCameras()[1].camera;
  const Camera reference = TypicalCameras()[0].camera;
  const auto calibration = [](const Camera& camera) {
    Matrix3d K;
    K << camera.focal_x_px(), 0, camera.principal_point_px().x(), 0, camera.focal_y_px(),
        camera.principal_point_px().y(), 0, 0, 1;
    return K;
  };
  for (int i = 0; i < 100; ++i) {
    const Rigid3 query_from_world = RandomRigid3(rng, 3);
    const Rigid3 reference_from_world = RandomRigid3(rng, 3);
    const Vector2d query_px = RandomPixel(rng, query);
    const Vector2d reference_px = RandomPixel(rng, reference);
    const Rigid3 relative = query_from_world * reference_from_world.Inverse();
    const Matrix3d F = calibration(query).inverse().transpose() * Skew(relative.translation) *
                       relative.rotation * calibration(reference).inverse();
    const Vector3d line_in_query = F * reference_px.homogeneous();
    const Vector3d line_in_reference = F.transpose() * query_px.homogeneous();
    const double expected = query_px.homogeneous().dot(line_in_query) /
                            std::sqrt(line_in_query.head<2>().squaredNorm() +
                                      line_in_reference.head<2>().squaredNorm());
    const auto residual = SampsonError(query, query_from_world, query_px, reference,
                                       reference_from_world, reference_px);
    ASSERT_TRUE(residual);
    EXPECT_NEAR(residual->error_px, expected, 1e-9 * (1 + std::abs(expected)));
  }
}

TEST(SampsonError, IsNoneWithoutABaseline) {
  Rng rng = TestRng();
  const Camera camera = TypicalCameras()[1].camera;
  for (const double extent : {0., 1., 1e6}) {
    const Rigid3 reference_from_world = RandomRigid3(rng, extent);
    const Eigen::Quaterniond turn = RotationFromVector({0.1, 0.2, 0.3});
    const Rigid3 query_from_world = {turn * reference_from_world.rotation,
                                     turn * reference_from_world.translation};
    EXPECT_FALSE(SampsonError(camera, reference_from_world, {10, 20}, camera, reference_from_world,
                              {30, 40}));
    EXPECT_FALSE(
        SampsonError(camera, query_from_world, {10, 20}, camera, reference_from_world, {30, 40}));
  }
}

TEST(SampsonError, IsNoneWhereAPixelHasNoRay) {
  const std::vector<double> params = {100, 320, 240, -1. / 12};  // folds 133 px off the center
  const Camera folding(CameraModel::kSimpleRadial, 640, 480, params);
  const Camera pinhole = TypicalCameras()[1].camera;
  const Rigid3 pose;
  const Rigid3 other = {Eigen::Quaterniond::Identity(), {1, 0, 0}};
  EXPECT_FALSE(SampsonError(folding, pose, {0, 0}, pinhole, other, {1, 1}));
  EXPECT_FALSE(SampsonError(pinhole, pose, {0, 0}, folding, other, {1, 1}));
  EXPECT_TRUE(SampsonError(folding, pose, {320, 200}, pinhole, other, {1, 1}));
}

TEST(ReprojectionError, IsNoneBehindTheCamera) {
  const Camera camera = TypicalCameras()[1].camera;
  EXPECT_FALSE(ReprojectionError(camera, Rigid3(), {0, 0, -1}, {320, 240}));
  EXPECT_FALSE(ReprojectionError(camera, Rigid3(), {0, 0, 0}, {320, 240}));
}

}  // namespace
}  // namespace raylift
