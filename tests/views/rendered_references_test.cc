#include "raylift/views/rendered_references.h"

#include <cmath>

#include "support/enum_names.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

double FovDeg(const Camera& camera) {
  return 2 * std::atan(0.5 * camera.width_px() / camera.focal_x_px()) * 180 / EIGEN_PI;
}

// A room whose floor is at z = 0.
std::shared_ptr<const RayCaster> Room() {
  TriangleMesh mesh = MakeBox({0, 0, 1.5}, {4, 3, 1.5});
  for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
  mesh.vertex_colors_rgb.assign(mesh.vertices.size(), {200, 100, 50});
  return std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(std::move(mesh)));
}

RenderedReferenceOptions SmallViews(const fs::path& out) {
  RenderedReferenceOptions options;
  options.out = out;
  options.views.camera = CenteredPinhole(40, 30, 30);
  options.views.count = 5;
  return options;
}

TEST(CameraLikeQueries, IsAsSharpAndAsWideAsThem) {
  const std::vector<Camera> queries = {CenteredPinhole(640, 480, 400),
                                       CenteredPinhole(640, 480, 500),
                                       CenteredPinhole(640, 480, 490)};
  const Camera camera = CameraLikeQueries(queries, {}, {});
  EXPECT_NEAR(camera.focal_x_px(), 490, 1);
  EXPECT_NEAR(FovDeg(camera), FovDeg(queries[2]), 1e-9);
  EXPECT_NEAR(camera.height_px(), 0.75 * camera.width_px(), 0.5);
}

TEST(CameraLikeQueries, IsNeitherNarrowNorHuge) {
  const std::vector<Camera> tele = {CenteredPinhole(640, 480, 2000)};
  EXPECT_NEAR(FovDeg(CameraLikeQueries(tele, {}, {})), 60, 1e-9);
  const std::vector<Camera> large = {CenteredPinhole(6000, 4000, 4000)};
  const Camera camera = CameraLikeQueries(large, {}, {});
  EXPECT_NEAR(camera.width_px(), 1600, 1);
  EXPECT_NEAR(camera.focal_x_px(), 4000 * 1600 / 6000., 1);
  const std::vector<Camera> fisheye = {
      {CameraModel::kOpenCvFisheye, 800, 800, std::vector<double>{250, 250, 400, 400, 0, 0, 0, 0}}};
  EXPECT_NEAR(FovDeg(CameraLikeQueries(fisheye, {}, {})), 100, 1e-9);
}

TEST(CameraLikeQueries, TakesWhatIsGiven) {
  const std::vector<Camera> queries = {CenteredPinhole(640, 480, 400)};
  const Camera camera = CameraLikeQueries(queries, PlaneSize{320, 200}, 50.0);
  EXPECT_EQ(camera.width_px(), 320);
  EXPECT_EQ(camera.height_px(), 200);
  EXPECT_NEAR(FovDeg(camera), 50, 1e-9);
}

TEST(RenderReferences, LeaveAModelAndItsImages) {
  const fs::path out = TestFolder();
  const RenderedReferences references = RenderReferences(Room(), SmallViews(out), {});
  EXPECT_EQ(references.count, 5u);
  EXPECT_EQ(references.rendered, 5u);
  EXPECT_EQ(references.kind, ViewKind::kInside);
  const auto images = ReadColmapModel(references.model).PosedImages();
  ASSERT_EQ(images.size(), 5u);
  for (const PosedImage& image : images) {
    EXPECT_NEAR(image.cam_from_world.OriginInSource().z(), 1.6, 1e-3);
    const Image picture = ReadImage(references.images / image.name, ImageChannels::kRgb);
    EXPECT_EQ(picture.width_px, 40);
    EXPECT_NEAR(picture.Pixel(20, 15)[0], 200, 6);
  }
}

TEST(RenderReferences, ASecondRunRendersOnlyWhatIsMissingOrChanged) {
  const fs::path out = TestFolder();
  RenderedReferenceOptions options = SmallViews(out);
  const RenderedReferences first = RenderReferences(Room(), options, {});
  const std::string picture = ReadFile(first.images / "rendered" / "0003.jpg");
  fs::remove(first.images / "rendered" / "0003.jpg");
  options.threads = 1;
  EXPECT_EQ(RenderReferences(Room(), options, {}).rendered, 1u);
  EXPECT_EQ(ReadFile(first.images / "rendered" / "0003.jpg"), picture);
  options.views.seed = 5;
  EXPECT_EQ(RenderReferences(Room(), options, {}).rendered, 5u);
}

TEST(RenderReferences, WithoutAGroundSurfacesAreCovered) {
  RenderedReferenceOptions options = SmallViews(TestFolder());
  options.views.up_in_world = {1, 0, 0};  // from wall to wall: too high for eyes of 20 units
  options.inside.eye_height = 20;
  EXPECT_EQ(RenderReferences(Room(), options, {}).kind, ViewKind::kCover);
}

TEST(RenderReferences, TakeTheKindThatIsAskedFor) {
  for (const ViewKind kind : {ViewKind::kInside, ViewKind::kCover}) {
    RenderedReferenceOptions options = SmallViews(TestFolder());
    options.kind = kind;
    EXPECT_EQ(RenderReferences(Room(), options, {}).kind, kind);
  }
  EXPECT_TRUE(NamesEveryValue<ViewKind>());
}

TEST(RenderReferences, WarnOfAMeshWithoutColors) {
  TriangleMesh bare = Room()->mesh();
  bare.vertex_colors_rgb.clear();
  const auto mesh =
      std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(std::move(bare)));
  const auto warnings = RenderReferences(mesh, SmallViews(TestFolder()), {}).warnings;
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_NE(warnings[0].find("neither texture nor vertex colors"), std::string::npos);
}

TEST(ColorsLikePhotographs, LightMeshesWithoutColors) {
  EXPECT_EQ(ColorsLikePhotographs(*Room()).shading, ColorOptions::Shading::kUnlit);
  const RayCaster box(std::make_shared<const TriangleMesh>(MakeBox({0, 0, 0}, {1, 1, 1})));
  EXPECT_EQ(ColorsLikePhotographs(box).shading, ColorOptions::Shading::kHeadlight);
}

}  // namespace
}  // namespace raylift
