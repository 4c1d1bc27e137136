#include "raylift/lifting/mesh_source.h"

#include <cmath>
#include <limits>
#include <numbers>

#include "support/enum_names.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

MeshSource MakeSource(TriangleMesh mesh) {
  return MeshSource("mesh:test", std::make_shared<const RayCaster>(
                                     std::make_shared<const TriangleMesh>(std::move(mesh))));
}

// Lifts random pixels of every camera model; compares with the closed form's length of the ray,
// given the ray from the eye in the world's directions (none: do not compare), and checks that
// the points project back onto their pixels.
template <typename RayLength>
void CheckSource(const MeshSource& source, const Rigid3& cam_from_world,
                 const RayLength& expected) {
  Rng rng = TestRng();
  for (const Camera& camera : CamerasOfEveryModel()) {
    const auto pixels = RandomPixels(camera, 1000, rng);
    const auto points = source.Lift({"reference", camera, cam_from_world}, pixels);
    ASSERT_EQ(points.size(), pixels.size());
    int compared = 0;
    for (size_t i = 0; i < pixels.size(); ++i) {
      const Eigen::Vector3d ray_in_cam = camera.RayInCam(pixels[i]).value();
      const Eigen::Vector3d ray = cam_from_world.rotation.conjugate() * ray_in_cam;
      const std::optional<double> length = expected(ray);
      if (!length) continue;
      ++compared;
      ASSERT_TRUE(points[i]) << camera.ToString();
      const double z = *length * ray_in_cam.z();
      EXPECT_NEAR(points[i]->depth_z, z, 1e-5 * z) << camera.ToString();
      const auto back = camera.ImgFromCam(cam_from_world * points[i]->point_in_world);
      ASSERT_TRUE(back) << camera.ToString();
      EXPECT_LT((*back - pixels[i]).norm(), 1e-4) << camera.ToString();
      EXPECT_LE(points[i]->normal_in_world.dot(ray), 0) << "turned to the camera";
    }
    EXPECT_GT(compared, 100) << camera.ToString();
  }
}

TEST(MeshSource, PlaneIsLiftedSubPixelExact) {
  for (const Eigen::Vector3d& center : {Eigen::Vector3d(0, 0, 0), kGeoreferenced}) {
    const MeshSource source =
        MakeSource(MakePlane({Eigen::Quaterniond::Identity(), center}, 60, 30));
    const Eigen::Vector3d eye(0.4, -0.7, -4);
    CheckSource(
        source, LookAt(center + eye, center + Eigen::Vector3d(1.5, 0.3, 0)),
        [&](const Eigen::Vector3d& ray) -> std::optional<double> { return -eye.z() / ray.z(); });
  }
}

TEST(MeshSource, SphereIsLiftedSubPixelExact) {
  for (const Eigen::Vector3d& center : {Eigen::Vector3d(0, 0, 0), kGeoreferenced}) {
    const MeshSource source = MakeSource(MakeSphere(center, 1, 500, 1000));
    const Eigen::Vector3d eye(1.2, -2.1, 0.8);
    CheckSource(source, LookAt(center + eye, center),
                [&](const Eigen::Vector3d& ray) -> std::optional<double> {
                  const double along = -eye.dot(ray);
                  const double cosine2 = 1 - (eye.squaredNorm() - along * along);
                  // A facet is up to 1e-5 inside the sphere; an oblique ray sees that enlarged.
                  if (cosine2 < 0.25) return std::nullopt;
                  return along - std::sqrt(cosine2);
                });
  }
}

TEST(MeshSource, BoxIsLiftedSubPixelExact) {
  const Eigen::Vector3d half(3, 2, 4);
  for (const Eigen::Vector3d& center : {Eigen::Vector3d(0, 0, 0), kGeoreferenced}) {
    const MeshSource source = MakeSource(MakeBox(center, half));
    const Eigen::Vector3d eye(0.5, -0.3, -1);
    CheckSource(
        source, LookAt(center + eye, center + Eigen::Vector3d(2, 1.5, 3)),
        [&](const Eigen::Vector3d& ray) -> std::optional<double> {
          return ((half.array() * ray.array().sign() - eye.array()) / ray.array()).minCoeff();
        });
  }
}

TEST(MeshSource, SaysIncidenceAndWhichSideItMet) {
  // Seen along z, the plane's normal is turned away by 50 degrees.
  const double turn_deg = 50;
  const Eigen::Quaterniond turn(
      Eigen::AngleAxisd(turn_deg * std::numbers::pi / 180, Eigen::Vector3d(0, 1, 0)));
  TriangleMesh mesh = MakePlane({turn, {0, 0, 3}}, 2, 1);
  const PosedImage reference{"reference", Camera(), Rigid3()};
  const Eigen::Vector2d pixel(0.5, 0.5);
  const Eigen::Vector3d toward_camera = turn * Eigen::Vector3d(0, 0, -1);

  const auto front = MakeSource(mesh).Lift(reference, {&pixel, 1})[0];
  ASSERT_TRUE(front);
  EXPECT_FALSE(front->back_face);
  EXPECT_NEAR(front->incidence_deg, turn_deg, 1e-5);
  EXPECT_LT((front->normal_in_world - toward_camera).norm(), 1e-6);
  EXPECT_NEAR(front->depth_z, 3, 1e-6);

  for (auto& triangle : mesh.triangles) std::swap(triangle[0], triangle[1]);
  const auto back = MakeSource(mesh).Lift(reference, {&pixel, 1})[0];
  ASSERT_TRUE(back);
  EXPECT_TRUE(back->back_face);
  EXPECT_NEAR(back->incidence_deg, turn_deg, 1e-5);
  EXPECT_LT((back->normal_in_world - toward_camera).norm(), 1e-6);
}

TEST(MeshSource, DepthJumpIsLargeAtSilhouettesAndSmallOnSlantedWalls) {
  const auto caster = std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(
      MergeMeshes({MakeBox({0, 0, 0}, {1, 1, 1}),
                   MakePlane({Eigen::Quaterniond::Identity(), {0, 0, 3}}, 60, 1)})));
  const double params[] = {500, 500, 320, 240};
  const PosedImage reference{"reference", Camera(CameraModel::kPinhole, 640, 480, params),
                             LookAt({0.4, 0.1, -5}, {0.4, 0.1, 0})};
  // The box's right side is at x = 0.6 of depth 4 in front: 75 px right of the center.
  const std::vector<Eigen::Vector2d> pixels = {{394, 240}, {396, 240}, {390, 240}, {400, 240}};
  const MeshSource all("mesh", caster, {.limits = {.max_depth_jump = 1e9}});
  const auto points = all.Lift(reference, pixels);
  for (const auto& point : points) ASSERT_TRUE(point);
  EXPECT_NEAR(*points[0]->depth_jump, 1, 0.1);  // 8 behind 4
  EXPECT_NEAR(*points[1]->depth_jump, 1, 0.1);
  EXPECT_LT(*points[2]->depth_jump, 1e-5);
  EXPECT_LT(*points[3]->depth_jump, 1e-5);
  const MeshSource some("mesh", caster, {.limits = {.max_depth_jump = 0.1}});
  const auto kept = some.Lift(reference, pixels);
  EXPECT_FALSE(kept[0] || kept[1]);
  EXPECT_TRUE(kept[2] && kept[3]);

  const PosedImage oblique{"reference", reference.camera, LookAt({30, 0, -5}, {20, 0, 3})};
  const auto wall = all.Lift(oblique, pixels);
  ASSERT_TRUE(wall[0]);
  EXPECT_LT(*wall[0]->depth_jump, 1e-5) << "a slanted wall has no jump";
  EXPECT_GT(wall[0]->incidence_deg, 40);
}

TEST(MeshSource, NearLooksThroughAndFarAndIncidenceDrop) {
  const auto caster = std::make_shared<const RayCaster>(
      std::make_shared<const TriangleMesh>(MakeBox({0, 0, 5}, {1, 1, 1})));
  const PosedImage reference{"reference", Camera(), Rigid3()};
  const Eigen::Vector2d pixel(0.5, 0.5);
  const auto depth = [&](const SurfaceLimits& limits) {
    const auto point = MeshSource("mesh", caster, {.limits = limits}).Lift(reference, {&pixel, 1});
    return point[0] ? point[0]->depth_z : 0;
  };
  EXPECT_NEAR(depth({}), 4, 1e-6);
  EXPECT_NEAR(depth({.near_z = 4.5}), 6, 1e-6);
  EXPECT_EQ(depth({.near_z = 4.5, .back_faces = SurfaceLimits::BackFaces::kDrop}), 0);
  EXPECT_EQ(depth({.far_z = 3.9}), 0);
  EXPECT_EQ(depth({.near_z = 7}), 0);
}

TEST(MeshSource, APointDoesNotDependOnWhatElseIsLifted) {
  Rng rng = TestRng();
  const auto caster = std::make_shared<const RayCaster>(
      std::make_shared<const TriangleMesh>(MakeSphere({0, 0, 0}, 1, 100, 200)));
  const double params[] = {500, 510, 322, 238};
  const PosedImage reference{"reference", Camera(CameraModel::kPinhole, 640, 480, params),
                             LookAt({1.2, -2.1, 0.8}, {0, 0, 0})};
  const auto pixels = RandomPixels(reference.camera, 700, rng);
  const MeshSource source("mesh", caster, {.limits = {.max_depth_jump = 1e9}});
  const MeshSource with_near("mesh", caster, {.limits = {.near_z = 0.01, .max_depth_jump = 1e9}});
  const auto together = source.Lift(reference, pixels);
  const auto from_near = with_near.Lift(reference, pixels);
  int num_lifted = 0;
  for (size_t i = 0; i < pixels.size(); ++i) {
    const auto alone = source.Lift(reference, {&pixels[i], 1})[0];
    ASSERT_EQ(together[i].has_value(), alone.has_value());
    ASSERT_EQ(together[i].has_value(), from_near[i].has_value());
    if (!alone) continue;
    ++num_lifted;
    // Float decides which of two neighboring triangles is hit at their edge.
    EXPECT_LT((together[i]->point_in_world - alone->point_in_world).norm(), 1e-6);
    EXPECT_LT((together[i]->point_in_world - from_near[i]->point_in_world).norm(), 1e-6);
    if (alone->incidence_deg < 70) {
      EXPECT_NEAR(*together[i]->depth_jump, *alone->depth_jump, 1e-5);
      EXPECT_NEAR(*together[i]->depth_jump, *from_near[i]->depth_jump, 1e-5);
    }
  }
  EXPECT_GT(num_lifted, 200);
}

TEST(MeshSource, PixelsWithoutRayOrSurfaceHaveNoPoint) {
  const MeshSource source = MakeSource(MakeBox({0, 0, 10}, {1, 1, 1}));
  // Barrel distortion that folds over within the image's corner.
  const double params[] = {50, 50, 50, -0.3};
  const Camera camera(CameraModel::kSimpleRadial, 100, 100, params);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  const std::vector<Eigen::Vector2d> pixels = {{50, 50}, {70, 50},  {0, 0},         {51, 52},
                                               {nan, 5}, {5, -1e9}, {infinity, nan}};
  ASSERT_FALSE(camera.RayInCam(pixels[2]));
  const auto points = source.Lift({"reference", camera, Rigid3()}, pixels);
  EXPECT_TRUE(points[0]);
  EXPECT_FALSE(points[1]);
  EXPECT_FALSE(points[2]);
  EXPECT_TRUE(points[3]);
  for (size_t i = 4; i < pixels.size(); ++i) EXPECT_FALSE(points[i]);
}

TEST(SurfaceLimits, TheirValuesHaveNames) {
  EXPECT_TRUE(NamesEveryValue<SurfaceLimits::BackFaces>());
  EXPECT_TRUE(NamesEveryValue<RayCasterOptions::BuildQuality>());
}

}  // namespace
}  // namespace raylift
