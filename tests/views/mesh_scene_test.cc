#include "raylift/views/mesh_scene.h"

#include "support/test_data.h"
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

TEST(LoadMeshScene, RefusesWhatDoesNotConcernRendering) {
  const auto folder = TestFolder();
  EXPECT_THROW(LoadMeshScene({TriangleSpec(folder, "a.obj") + ",near=1"}), OptionError);
  EXPECT_THROW(LoadMeshScene({"depth:maps"}), OptionError);
}

}  // namespace
}  // namespace raylift
