// Every map of a frame against closed forms, and depth against a plain loop in double.

#include "raylift/renderers/frame_renderer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "renderers/casters.h"
#include "support/enum_names.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

const Eigen::Vector3d kHalf(3, 2, 4);
const Eigen::Vector3d kEye(0.5, -0.3, -1);  // from the box's center

std::shared_ptr<const RayCaster> ShareCaster(TriangleMesh mesh) {
  return std::make_shared<const RayCaster>(MakeCaster(std::move(mesh)));
}

FrameOptions AllMaps() {
  FrameOptions options;
  options.depth = options.distance = options.normals = options.triangle = options.incidence =
      options.mask = true;
  return options;
}

std::vector<PixelRays> RaysOfEveryCamera() {
  std::vector<PixelRays> rays;
  for (const Camera& camera : CamerasOfEveryModel()) rays.emplace_back(camera, 1);
  rays.emplace_back(Camera::Panorama(64, 32), 1);
  return rays;
}

// What a ray from within the box meets.
struct BoxHit {
  double t;
  Eigen::Vector3d inward_normal;
};

BoxHit HitBox(const Eigen::Vector3d& direction) {
  const Eigen::Array3d exits =
      (kHalf.array() * direction.array().sign() - kEye.array()) / direction.array();
  int axis = 0;
  const double t = exits.minCoeff(&axis);
  return {t, -std::copysign(1.0, direction[axis]) * Eigen::Vector3d::Unit(axis)};
}

TEST(FrameRenderer, EveryMapOfABoxIsTheClosedFormsInEveryCamera) {
  const TriangleMesh box = MakeBox(kGeoreferenced, kHalf);
  const auto caster = ShareCaster(box);
  const Rigid3 pose = LookAt(kGeoreferenced + kEye, kGeoreferenced + Eigen::Vector3d(2, 1.5, 3));
  const FrameRenderer renderer(caster, AllMaps());
  Frame frame;
  for (const PixelRays& rays : RaysOfEveryCamera()) {
    renderer.Render(rays, pose, 2, frame);
    const auto pixels =
        static_cast<size_t>(rays.width_px()) * static_cast<size_t>(rays.height_px());
    EXPECT_EQ(frame.num_hits, pixels);
    for (size_t i = 0; i < pixels; ++i) {
      const auto ray = rays.RayInCam(static_cast<int>(i) % rays.width_px(),
                                     static_cast<int>(i) / rays.width_px());
      ASSERT_TRUE(ray);
      const Eigen::Vector3d direction = pose.rotation.conjugate() * *ray;
      const BoxHit hit = HitBox(direction);
      ASSERT_NEAR(frame.distance[i], hit.t, 1e-5 * hit.t);
      const double depth = rays.is_panorama() ? hit.t : hit.t * ray->z();
      ASSERT_NEAR(frame.depth[i], depth, 1e-5 * depth);
      ASSERT_EQ(frame.mask.data[i], 255);
      const auto& [a, b, c] = box.triangles[frame.triangle[i]];
      const Eigen::Vector3f outward =
          (box.vertices[b] - box.vertices[a]).cross(box.vertices[c] - box.vertices[a]).normalized();
      const Eigen::Vector3f normal(frame.normals[3 * i], frame.normals[3 * i + 1],
                                   frame.normals[3 * i + 2]);
      ASSERT_LT((normal + outward).norm(), 1e-6f) << "normal and id are of one triangle";
      // On an edge of the box either side is right.
      const Eigen::Vector3d point = kEye + hit.t * direction;
      const auto sides = (point.array().abs() > kHalf.array() - 1e-4).count();
      if (sides > 1) continue;
      ASSERT_LT((normal.cast<double>() - hit.inward_normal).norm(), 1e-6);
      const double incidence_deg =
          std::acos(-hit.inward_normal.dot(direction)) * 180 / std::numbers::pi;
      ASSERT_NEAR(frame.incidence_deg[i], incidence_deg, 1e-3);
    }
  }
}

TEST(FrameRenderer, NormalsInTheCameraAreThoseOfTheWorldTurned) {
  const auto caster = ShareCaster(MakeSphere({0, 0, 4}, 1, 30, 60));
  const Rigid3 pose = LookAt({0.5, -2, 1}, {0, 0, 4});
  const PixelRays rays(CamerasOfEveryModel().front(), 1);
  FrameOptions options = AllMaps();
  Frame world;
  FrameRenderer(caster, options).Render(rays, pose, 1, world);
  options.normals_in = FrameOptions::NormalsIn::kCamera;
  Frame camera;
  FrameRenderer(caster, options).Render(rays, pose, 1, camera);
  size_t hits = 0;
  for (size_t i = 0; i < world.mask.data.size(); ++i) {
    const Eigen::Map<const Eigen::Vector3f> in_world(&world.normals[3 * i]);
    const Eigen::Map<const Eigen::Vector3f> in_camera(&camera.normals[3 * i]);
    hits += world.mask.data[i] != 0 ? 1 : 0;
    EXPECT_LT((pose.rotation.cast<float>() * in_world - in_camera).norm(), 1e-6f);
    EXPECT_EQ(in_world.isZero(), world.mask.data[i] == 0);
    EXPECT_EQ(world.incidence_deg[i] < 0, world.mask.data[i] == 0);
    EXPECT_EQ(world.triangle[i] == HitBlock::kNoTriangle, world.mask.data[i] == 0);
    EXPECT_EQ(world.depth[i] == 0, world.mask.data[i] == 0);
  }
  EXPECT_EQ(hits, world.num_hits);
}

TEST(FrameRenderer, AMillionRaysFindNoHoleInAClosedMesh) {
  const auto caster = ShareCaster(MakeSphere(kGeoreferenced, 7, 60, 120));
  FrameOptions options;
  options.mask = true;
  const FrameRenderer renderer(caster, options);
  const PixelRays rays(Camera::Panorama(1000, 500), 2);
  Rng rng = TestRng();
  Frame frame;
  for (int i = 0; i < 2; ++i) {
    const Rigid3 turn = RandomRigid3(rng, 4);
    const Rigid3 pose{turn.rotation, -(turn.rotation * (kGeoreferenced + turn.translation))};
    renderer.Render(rays, pose, 2, frame);
    EXPECT_EQ(frame.num_hits, size_t{500000});
  }
}

// The depth of the nearest triangle on a ray of which z is 1, in double, without any of Embree.
double NearestDepth(const TriangleMesh& mesh, const Eigen::Vector3d& origin,
                    const Eigen::Vector3d& direction) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const auto& [i0, i1, i2] : mesh.triangles) {
    const Eigen::Vector3d v0 = mesh.vertices[i0].cast<double>();
    const Eigen::Vector3d e1 = mesh.vertices[i1].cast<double>() - v0;
    const Eigen::Vector3d e2 = mesh.vertices[i2].cast<double>() - v0;
    const Eigen::Vector3d p = direction.cross(e2);
    const double determinant = e1.dot(p);
    const Eigen::Vector3d s = origin - v0;
    const double u = s.dot(p) / determinant;
    if (!(u >= 0 && u <= 1)) continue;
    const Eigen::Vector3d q = s.cross(e1);
    const double v = direction.dot(q) / determinant;
    if (!(v >= 0 && u + v <= 1)) continue;
    const double t = e2.dot(q) / determinant;
    if (t > 0) nearest = std::min(nearest, t);
  }
  return std::isfinite(nearest) ? nearest : 0;
}

TEST(FrameRenderer, DepthOfARealMeshIsThatOfAPlainLoop) {
  const auto data = FindTestData("rgbd_small");
  if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
  const TriangleMesh mesh = ReadMesh(*data / "mesh.ply");
  FrameOptions options;
  options.depth = true;
  const FrameRenderer renderer(ShareCaster(mesh), options);
  const double params[] = {14.5, 8, 6, -0.05};
  const PixelRays rays(Camera(CameraModel::kSimpleRadial, 16, 12, params), 1);
  const Rigid3 pose;  // that of the sequence's first frame
  Frame frame;
  renderer.Render(rays, pose, 2, frame);
  size_t differ = 0;
  size_t hits = 0;
  for (int i = 0; i < 16 * 12; ++i) {
    const auto ray = rays.RayInCam(i % 16, i / 16);
    ASSERT_TRUE(ray);
    const double expected = NearestDepth(mesh, -mesh.origin_in_world, *ray / ray->z());
    hits += expected > 0 ? 1 : 0;
    const double actual = frame.depth[static_cast<size_t>(i)];
    if (std::abs(actual - expected) > 1e-4 * expected) ++differ;
  }
  EXPECT_GT(hits, 130u);
  // Rays that pass a silhouette within the rounding of float may fall on its other side.
  EXPECT_LE(differ, 1u) << "of " << hits;
}

TEST(FrameOptions, TheirValuesHaveNames) {
  EXPECT_TRUE(NamesEveryValue<ColorOptions::Shading>());
  EXPECT_TRUE(NamesEveryValue<FrameOptions::NormalsIn>());
}

}  // namespace
}  // namespace raylift
