#include "views/mesh_scene.h"

#include "support/matchers.h"
#include "support/splat_files.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

std::string TriangleSpec(const std::filesystem::path& folder, const std::string& name) {
  const auto path = folder / name;
  WriteFile(path, "v -1 -1 2\nv 1 -1 2\nv 0 1 2\nf 1 2 3\n");
  return "mesh:" + path.string();
}

TEST(LoadMeshScene, SeveralMeshesAreOneScene) {
  const auto folder = TestFolder();
  const std::string a = TriangleSpec(folder, "a.obj");
  const std::string b = TriangleSpec(folder, "b.obj");
  EXPECT_EQ(LoadMeshScene({a, b}).caster->mesh().triangles.size(), 2u);
  EXPECT_EQ(LoadMeshScene({a + ",build=low", b}).caster->mesh().triangles.size(), 2u);
  EXPECT_EQ(LoadMeshScene({a + ",build=low", b + ",build=low"}).caster->mesh().triangles.size(),
            2u);
}

TEST(LoadMeshScene, EarthCenteredTilesBesideOthersNeedTheirSystem) {
  const auto folder = TestFolder();
  const auto tiles = folder / "tileset.json";
  WriteFile(tiles, R"({"asset":{"version":"1.0"},"root":{"geometricError":0,
"boundingVolume":{"sphere":[3741100,652926,5107187,9]}}})");
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        LoadMeshScene({TriangleSpec(folder, "a.obj"), "mesh:" + tiles.string()});
      },
      {"tileset.json: earth-centered 3D Tiles beside other meshes", "expected crs=EPSG:N"}));
}

TEST(LoadMeshScene, ContradictoryBuildsAreAnOptionError) {
  const auto folder = TestFolder();
  const std::string a = TriangleSpec(folder, "a.obj") + ",build=medium";
  const std::string b = TriangleSpec(folder, "b.obj") + ",build=low";
  try {
    LoadMeshScene({a, b});
    FAIL() << "no OptionError";
  } catch (const OptionError& error) {
    EXPECT_EQ(error.what(),
              "geometry = " + b + ": all meshes are one scene, but another one says build=medium");
  }
}

TEST(LoadMeshScene, APointCloudIsAlone) {
  const auto folder = TestFolder();
  std::string points;
  for (int i = 0; i < 400; ++i) points += fmt::format("{} {} 2\n", i % 20, i / 20);
  WriteFile(folder / "wall.xyz", points);
  const std::string cloud = "cloud:" + (folder / "wall.xyz").string();
  const MeshScene scene = LoadMeshScene({cloud});
  EXPECT_EQ(scene.caster->surfels()->discs.size(), 400u);
  EXPECT_GT(scene.mesh_bytes, 400u * 4 * sizeof(float));
  EXPECT_THROW(LoadMeshScene({TriangleSpec(folder, "a.obj"), cloud}), OptionError);
  EXPECT_THROW(LoadMeshScene({cloud + ",far=1"}), OptionError);
}

TEST(LoadMeshScene, SplatsAreAlone) {
  const auto folder = TestFolder();
  WriteFile(folder / "wall.ply", SplatPly({{TestSplat{}}}, SplatLayout::kEllipsoids));
  const std::string splats = "splat:" + (folder / "wall.ply").string();
  const MeshScene scene = LoadMeshScene({splats + ",depth=peak"});
  EXPECT_EQ(scene.caster->splats()->means.size(), 1u);
  EXPECT_EQ(scene.caster->splat_depth(), SplatDepth::kPeak);
  EXPECT_GT(scene.mesh_bytes, 0u);
  EXPECT_THROW(LoadMeshScene({TriangleSpec(folder, "a.obj"), splats}), OptionError);
  EXPECT_THROW(LoadMeshScene({splats + ",far=1"}), OptionError);
}

TEST(LoadMeshScene, RefusesWhatDoesNotConcernRendering) {
  const auto folder = TestFolder();
  EXPECT_THROW(LoadMeshScene({TriangleSpec(folder, "a.obj") + ",near=1"}), OptionError);
  EXPECT_THROW(LoadMeshScene({"depth:maps"}), OptionError);
}

}  // namespace
}  // namespace raylift
