#include "raylift/lifting/geometry_spec.h"

#include "support/matchers.h"
#include "support/splat_files.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

std::string WriteTriangle(const std::string& name) {
  const auto path = TestFolder() / name;
  WriteFile(path, "v -1 -1 2\nv 1 -1 2\nv 0 1 2\nf 1 2 3\nf 1 1 2\n");
  return path.string();
}

std::string OptionErrorOf(const std::string& spec) {
  try {
    MakeGeometrySource(spec);
  } catch (const OptionError& error) {
    return error.what();
  }
  return "no OptionError";
}

TEST(MakeGeometrySource, OpensAMeshAndPassesItsWarningsOn) {
  const std::string path = WriteTriangle("one.obj");
  for (const std::string options : {"", ",build=low", ",build=medium"}) {
    const NamedGeometry geometry = MakeGeometrySource("mesh:" + path + options);
    EXPECT_EQ(geometry.source->Description(), "mesh:" + path);
    ASSERT_EQ(geometry.warnings.size(), 1u);
    EXPECT_NE(geometry.warnings[0].find("no area"), std::string::npos);
    const Eigen::Vector2d pixel(0.5, 0.5);
    EXPECT_TRUE(geometry.source->Lift({}, {&pixel, 1})[0]);
  }
}

TEST(MakeGeometrySource, AFileAloneIsOfTheKindThatItsNameSays) {
  EXPECT_EQ(GeometrySpecOf("a/b.obj,far=3"), "mesh:a/b.obj,far=3");
  EXPECT_EQ(GeometrySpecOf("a/B.OBJ"), "mesh:a/B.OBJ");
  EXPECT_EQ(GeometrySpecOf("a/tileset.json"), "mesh:a/tileset.json");
  EXPECT_EQ(GeometrySpecOf("scan.las"), "cloud:scan.las");
  for (const std::string text : {"mesh:a.obj", "depth:a.obj", "room=a.obj", "maps", "sfm", ""}) {
    EXPECT_EQ(GeometrySpecOf(text), text);
  }
  const std::string path = WriteTriangle("one.obj");
  EXPECT_EQ(MakeGeometrySource(path).source->Description(), "mesh:" + path);
}

TEST(MakeGeometrySource, UnknownKindsKeysAndValuesAreOptionErrors) {
  const std::string forms =
      ": expected mesh:PATH[,key=value...], dsm:FILE[,key=value...], cloud:PATH[,key=value...], "
      "splat:FILE[,key=value...], "
      "depth:PATH[,key=value...] or sfm[:DIR][,key=value...]";
  for (const std::string spec : {"foo:x", "cloud", "cloud:", "splat", "splat:", "mesh",
                                 "mesh:", "mesh,far=1", "depth:", "sfmx:a", ""}) {
    EXPECT_EQ(OptionErrorOf(spec).substr(0, ("geometry = " + spec + forms).size()),
              "geometry = " + spec + forms);
  }
  const auto says = [](const std::string& spec, const std::string& constraint) {
    const std::string message = OptionErrorOf(spec);
    EXPECT_TRUE(message.starts_with("geometry = " + spec + ": ")) << message;
    EXPECT_NE(message.find(constraint), std::string::npos) << message;
  };
  says("mesh:a.ply,size=3", "unknown key \"size\"; there are near, far");
  says("mesh:a.ply,build=best", "expected build=low|medium");
  says("mesh:a.ply,build", "expected key=value, found \"build\"");
  says("mesh:a.ply,near=1,near=2", "the key near stands twice");
  says("mesh:a.ply,far=-1", "expected far=NUMBER of at least 0, found \"-1\"");
  says("mesh:a.ply,near=x", "expected near=NUMBER");
  says("mesh:a.ply,back_faces=no", "expected back_faces=keep|drop");
  says("cloud:a.ply,radius=0", "expected radius=auto or a positive number");
  says("cloud:a.ply,neighbors=2", "expected neighbors=8 to 1000");
  says("cloud:a.ply,back_faces=drop", "unknown key \"back_faces\"; there are radius=auto|NUMBER");
  says("splat:a.ply,depth=mean", "expected depth=median|expected|peak");
  says("splat:a.ply,back_faces=drop", "unknown key \"back_faces\"; there are depth=median");
  says("splat:a.ply,scale=0", "expected a positive scale");
  says("depth:d,preset=foo", "expected preset=colmap|nerfstudio|");
  says("depth:d,kind=y", "expected kind=z|ray|inverse");
  says("depth:d,orientation=left", "expected orientation=as_stored|flipped_x|");
  says("depth:d,unit=foot", "expected unit=m|cm|mm");
  says("depth:d,unit=0", "expected unit=m|cm|mm");
  says("depth:d,scale=0", "expected a positive scale");
  says("depth:d,size=3", "expected size=WIDTHxHEIGHT");
  says("depth:d,size=3x0", "expected size=WIDTHxHEIGHT");
  says("depth:d,invalid=0/x", "expected invalid=NUMBER[/NUMBER...]");
  says("depth:d,interpolation=cubic", "expected interpolation=edge|nearest");
  says("sfm", "expected sfm:DIR");
  says("sfm:m,radius=-1", "expected radius=NUMBER of at least 0");
  says("sfm:m,preset=tum", "unknown key \"preset\"; there are radius");
  says("depth:d,build=low", "unknown key \"build\"; there are preset");
}

TEST(MakeGeometrySource, OpensAPointCloud) {
  const auto path = TestFolder() / "wall.xyz";  // 2 in front of the camera, as the triangle's
  std::string text;
  for (int y = -20; y <= 20; ++y) {
    for (int x = -20; x <= 20; ++x) text += fmt::format("{} {} 2\n", 0.05 * x, 0.05 * y);
  }
  WriteFile(path, text);
  const Eigen::Vector2d pixel(0.5, 0.5);
  for (const auto& [keys, depth] :
       {std::pair("", 2.0), {",scale=2", 4.0}, {",radius=0.2", 2.0}, {",neighbors=8", 2.0}}) {
    const NamedGeometry geometry = MakeGeometrySource("cloud:" + path.string() + keys);
    EXPECT_EQ(geometry.kind, GeometryKind::kCloud);
    EXPECT_EQ(geometry.source->Description(), "cloud:" + path.string());
    const auto point = geometry.source->Lift({}, {&pixel, 1})[0];
    ASSERT_TRUE(point) << keys;
    EXPECT_NEAR(point->depth_z, depth, 1e-5);
    EXPECT_FALSE(point->back_face);
    ASSERT_TRUE(point->point_sigma);
    EXPECT_LT(*point->point_sigma, 1e-5) << "the points are on a plane";
  }
  const NamedGeometry near = MakeGeometrySource("cloud:" + path.string() + ",far=1");
  EXPECT_FALSE(near.source->Lift({}, {&pixel, 1})[0]);
}

// A disc across the ray of the first pixel, two units away, in front of a fainter one.
std::filesystem::path WriteSplats() {
  const auto path = TestFolder() / "splats.ply";
  const std::vector<TestSplat> splats = {
      {.mean = {0, 0, 2}, .scale = {1, 1, 1e-3}, .opacity = 0.6},
      {.mean = {0, 0, 3}, .scale = {1, 1, 1e-3}, .opacity = 0.5}};
  WriteFile(path, SplatPly(splats, SplatLayout::kEllipsoids));
  return path;
}

TEST(MakeGeometrySource, OpensSplats) {
  const auto path = WriteSplats();
  const Eigen::Vector2d pixel(0.5, 0.5);
  for (const auto& [keys, depth] : {std::pair("", 2.0),
                                    {",depth=peak", 2.0},
                                    {",depth=expected", (0.6 * 2 + 0.2 * 3) / 0.8},
                                    {",scale=2", 4.0},
                                    {",max_depth_jump=0.1,jump_radius_px=0.001", 2.0}}) {
    const NamedGeometry geometry = MakeGeometrySource("splat:" + path.string() + keys);
    EXPECT_EQ(geometry.kind, GeometryKind::kSplats);
    EXPECT_EQ(geometry.source->Description(), "splat:" + path.string());
    EXPECT_NE(geometry.Surface(), nullptr);
    EXPECT_NE(geometry.interpretation.find("2 Gaussians"), std::string::npos)
        << geometry.interpretation;
    const auto point = geometry.source->Lift({}, {&pixel, 1})[0];
    ASSERT_TRUE(point) << keys;
    EXPECT_NEAR(point->depth_z, depth, 1e-5);
    EXPECT_NEAR(point->incidence_deg, 0, 1e-3);
    EXPECT_FALSE(point->back_face);
    ASSERT_TRUE(point->point_sigma);
    EXPECT_GT(*point->point_sigma, 0.1) << "there is light from both";
  }
  EXPECT_FALSE(
      MakeGeometrySource("splat:" + path.string() + ",far=1").source->Lift({}, {&pixel, 1})[0]);
  EXPECT_TRUE(FailsWithInputError([] { MakeGeometrySource("splat:/nowhere/a.ply"); },
                                  {"/nowhere/a.ply", "cannot be read"}));
}

// nerfstudio's dataparser: point_in_model = scale * (transform * point_in_world).
TEST(MakeGeometrySource, UndoesWhatNerfstudioDidToTheFrame) {
  const auto path = WriteSplats();
  const Eigen::Vector2d pixel(0.5, 0.5);
  // In the model the disc is at (0, 0, 2): in the world at (0, 0, 2 / 0.25 - 3) = (0, 0, 5).
  const std::string transforms =
      R"({"transform": [[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 3]], "scale": 0.25})";
  const auto depth_with = [&](const std::string& keys) {
    const NamedGeometry geometry = MakeGeometrySource("splat:" + path.string() + keys);
    return geometry.source->Lift({}, {&pixel, 1})[0].value().depth_z;
  };
  EXPECT_NEAR(depth_with(""), 2, 1e-5);
  const auto elsewhere = path.parent_path() / "run";
  std::filesystem::create_directories(elsewhere);
  WriteFile(elsewhere / "t.json", transforms);
  EXPECT_NEAR(depth_with(",transform=" + (elsewhere / "t.json").string()), 5, 1e-5);
  WriteFile(path.parent_path() / "dataparser_transforms.json", transforms);
  EXPECT_NEAR(depth_with(""), 5, 1e-5) << "it is found beside the splats";
  EXPECT_NEAR(depth_with(",scale=2"), 10, 1e-5) << "the placement comes after it";
  EXPECT_NEAR(depth_with(",transform=none"), 2, 1e-5);
  EXPECT_NE(MakeGeometrySource("splat:" + path.string())
                .interpretation.find("dataparser_transforms.json"),
            std::string::npos);
  for (const auto& [text, part] :
       {std::pair("{}", "transform"),
        {R"({"transform": [[1, 0, 0, 0], [0, 1, 0, 0]], "scale": 1})", "transform"},
        {R"({"transform": [[1, 0, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0]], "scale": 1})", "transform"},
        {R"({"transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "scale": 0})", "scale"}}) {
    WriteFile(elsewhere / "bad.json", text);
    const std::string keys = ",transform=" + (elsewhere / "bad.json").string();
    EXPECT_TRUE(FailsWithInputError([&] { depth_with(keys); }, {"bad.json", part}));
  }
}

TEST(MakeGeometrySource, EveryKeyOfAMeshWorks) {
  const std::string path = WriteTriangle("one.obj");  // 2 in front of the camera
  const auto lifts = [&](const std::string& keys) {
    const NamedGeometry geometry = MakeGeometrySource("mesh:" + path + keys);
    const Eigen::Vector2d pixel(0.5, 0.5);
    return geometry.source->Lift({}, {&pixel, 1})[0].has_value();
  };
  EXPECT_TRUE(lifts(",near=1.9,far=2.1,max_incidence_deg=1"));
  EXPECT_FALSE(lifts(",near=2.1"));
  EXPECT_FALSE(lifts(",far=1.9"));
  EXPECT_FALSE(lifts(",back_faces=drop"));
  EXPECT_TRUE(lifts(",back_faces=keep"));
  EXPECT_TRUE(lifts(",max_depth_jump=0.1,jump_radius_px=0.01"));
  EXPECT_FALSE(lifts(",max_depth_jump=0.1,jump_radius_px=2"));
}

TEST(MakeGeometrySource, AFileThatIsMissingIsAnInputError) {
  EXPECT_TRUE(FailsWithInputError([] { MakeGeometrySource("mesh:/nowhere/a.ply"); },
                                  {"/nowhere/a.ply", "no such file"}));
}

}  // namespace
}  // namespace raylift
