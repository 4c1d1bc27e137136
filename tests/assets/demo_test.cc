// The committed demo scene is complete and its parts agree.

#include <filesystem>
#include <set>

#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/io/colmap_model.h"
#include "raylift/io/image_file.h"
#include "raylift/io/query_list.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

void ExpectImagesFitTheirCameras(const std::vector<PosedImage>& views) {
  for (const PosedImage& view : views) {
    const Image image = ReadImage(DemoFolder() / "images" / view.name, ImageChannels::kRgb);
    EXPECT_EQ(image.width_px, view.camera.width_px()) << view.name;
    EXPECT_EQ(image.height_px, view.camera.height_px()) << view.name;
  }
}

TEST(Demo, ImagesFitTheirCameras) {
  const auto references = ReadColmapModel(DemoFolder() / "model").PosedImages();
  EXPECT_EQ(references.size(), 24);
  ExpectImagesFitTheirCameras(references);
  const auto queries = ReadColmapModel(DemoFolder() / "ground_truth").PosedImages();
  EXPECT_EQ(queries.size(), 12);
  ExpectImagesFitTheirCameras(queries);
}

TEST(Demo, QueryListAndGroundTruthHoldTheSameQueries) {
  const auto queries = ReadQueryList(DemoFolder() / "queries.txt");
  const auto ground_truth = ReadColmapModel(DemoFolder() / "ground_truth").PosedImages();
  ASSERT_EQ(queries.size(), ground_truth.size());
  for (size_t i = 0; i < queries.size(); ++i) {
    EXPECT_EQ(queries[i].name, ground_truth[i].name);
    EXPECT_EQ(queries[i].camera, ground_truth[i].camera);
  }
}

TEST(Demo, MeshIsTexturedAndWithoutDefects) {
  const TriangleMesh mesh = ReadMesh(DemoFolder() / "scene.obj");
  EXPECT_EQ(mesh.warnings, std::vector<std::string>());
  EXPECT_EQ(mesh.textures.size(), 6);
  EXPECT_GT(mesh.triangles.size(), 10000);
  EXPECT_EQ(std::set<int32_t>(mesh.triangle_textures.begin(), mesh.triangle_textures.end()),
            (std::set<int32_t>{0, 1, 2, 3, 4, 5}));
}

// The visible sides of the ground and of the four walls face the yard's middle.
TEST(Demo, WallsFaceTheYard) {
  const RayCaster caster(
      std::make_shared<const TriangleMesh>(ReadMesh(DemoFolder() / "scene.obj")));
  const Eigen::Vector3d above_fountain(8, 6, 5.1);
  std::vector<Ray> rays;
  for (const Eigen::Vector3d& direction :
       {Eigen::Vector3d(1, 0.05, 0), Eigen::Vector3d(-1, 0.05, 0), Eigen::Vector3d(0.05, 1, 0),
        Eigen::Vector3d(0.05, -1, 0), Eigen::Vector3d(0.5, 0.1, -1)}) {
    rays.push_back({above_fountain, direction});
  }
  const auto hits = caster.Cast(rays);
  for (size_t i = 0; i < rays.size(); ++i) {
    ASSERT_TRUE(hits[i]) << "ray " << i;
    EXPECT_LT(hits[i]->normal_in_world.dot(rays[i].direction_in_world), 0) << "ray " << i;
  }
}

}  // namespace
}  // namespace raylift
