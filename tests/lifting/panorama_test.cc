// References that see all around them: every source lifts in every direction, and depth is the
// distance.

#include <cmath>

#include "lifting/depth_convention.h"
#include "lifting/sfm_source.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include <gtest/gtest.h>

#include "raylift/lifting/depth_source.h"
#include "raylift/lifting/mesh_source.h"
#include "raylift/renderers/frame_renderer.h"

namespace raylift {
namespace {

class Panorama : public ::testing::Test {
 protected:
  // Where the ray of a pixel leaves the box.
  Eigen::Vector3d PointOnBox(const Eigen::Vector2d& pixel) const {
    const Eigen::Vector3d eye = reference_.cam_from_world.OriginInSource();
    const Eigen::Vector3d ray =
        reference_.cam_from_world.rotation.conjugate() * *reference_.camera.RayInCam(pixel);
    const double t = ((half_.array() * ray.array().sign() - eye.array()) / ray.array()).minCoeff();
    return eye + t * ray;
  }

  const Eigen::Vector3d half_{3, 2, 4};
  const std::shared_ptr<const RayCaster> caster_ = std::make_shared<const RayCaster>(
      std::make_shared<const TriangleMesh>(MakeBox(Eigen::Vector3d::Zero(), half_)));
  const PosedImage reference_{
      "panorama.jpg",
      Camera(CameraModel::kEquirectangular, 256, 128, std::vector<double>{256, 128}),
      LookAt({0.5, -0.3, -1}, {2, 1.5, 3})};
};

TEST_F(Panorama, MeshesAreLiftedInAllDirections) {
  Rng rng = TestRng();
  std::vector<Eigen::Vector2d> pixels;
  for (int i = 0; i < 500; ++i) pixels.emplace_back(rng.Uniform(0, 256), rng.Uniform(0, 128));
  const auto points = MeshSource("mesh:box", caster_).Lift(reference_, pixels);
  size_t num_behind = 0;
  for (size_t i = 0; i < pixels.size(); ++i) {
    ASSERT_TRUE(points[i]) << pixels[i].transpose();
    const Eigen::Vector3d in_cam = reference_.cam_from_world * points[i]->point_in_world;
    EXPECT_LT((points[i]->point_in_world - PointOnBox(pixels[i])).norm(), 1e-5);
    EXPECT_NEAR(points[i]->depth_z, in_cam.norm(), 1e-5);
    num_behind += in_cam.z() < 0;
  }
  EXPECT_GT(num_behind, 200u);
}

// Between the pixels' centers of a rendered map; the edges of the box are left out.
TEST_F(Panorama, RenderedDepthIsTheDistanceAndIsLiftedBack) {
  const DepthMap map = RenderDepth(*caster_, reference_.camera, reference_.cam_from_world, 1);
  StoredDepth stored;
  stored.width_px = map.width_px;
  stored.height_px = map.height_px;
  stored.values = map.z;
  stored.sample_type = "float32";
  for (const DepthKind kind : {DepthKind::kZ, DepthKind::kRay}) {
    EXPECT_EQ(ToDepthMap(stored, reference_.camera, {.kind = kind}).z, map.z);
  }
  Rng rng = TestRng();
  std::vector<Eigen::Vector2d> pixels;
  for (int i = 0; i < 500; ++i) pixels.emplace_back(rng.Uniform(1, 255), rng.Uniform(8, 120));
  const auto points = LiftByDepthMap(map, reference_, pixels);
  size_t num_near = 0, num_behind = 0;
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (!points[i]) continue;
    const bool is_near = (points[i]->point_in_world - PointOnBox(pixels[i])).norm() < 0.01;
    num_near += is_near;
    num_behind += is_near && (reference_.cam_from_world * points[i]->point_in_world).z() < 0;
  }
  EXPECT_GT(num_near, 450u);
  EXPECT_GT(num_behind, 180u);
}

TEST_F(Panorama, SfmPointsBehindAreLifted) {
  ColmapModel model;
  model.cameras[1] = reference_.camera;
  ColmapImage& image = model.images[1];
  image.name = reference_.name;
  image.camera_id = 1;
  image.SetCamFromWorld(reference_.cam_from_world);
  const Eigen::Vector2d ahead(128, 64), behind(10, 70);
  image.points2d = {{ahead, 1}, {behind, 2}};
  model.points3d[1].position_in_world = PointOnBox(ahead);
  model.points3d[1].track = {{1, 0}};
  model.points3d[2].position_in_world = PointOnBox(behind);
  model.points3d[2].track = {{1, 1}};
  const std::vector<Eigen::Vector2d> pixels = {ahead, behind};
  const auto points = SfmSource("sfm", model, {}).Lift(reference_, pixels);
  for (size_t i = 0; i < 2; ++i) {
    ASSERT_TRUE(points[i]) << i;
    EXPECT_EQ(points[i]->point_in_world, PointOnBox(pixels[i]));
    EXPECT_NEAR(points[i]->depth_z, (reference_.cam_from_world * points[i]->point_in_world).norm(),
                1e-12);
  }
}

}  // namespace
}  // namespace raylift
