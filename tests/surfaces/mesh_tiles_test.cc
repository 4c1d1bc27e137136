#include <array>

#include "support/matchers.h"
#include "support/meshes.h"
#include "support/test_data.h"

#include "raylift/base/file.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

TEST(MeshTiles, RaysMeetEveryTileWhereItIs) {
  // Tiles of a map: coordinates of millions, a kilometer apart.
  const Eigen::Vector3d origin(4e5, 5e6, 300);
  const Eigen::Vector3d apart(1000, 0, 0);
  const RayCaster caster(std::make_shared<const TriangleMesh>(
      MergeMeshes({MakeBox(origin, {1, 1, 1}), MakeBox(origin + apart, {1, 1, 1})})));
  for (const Eigen::Vector3d& center : {origin, Eigen::Vector3d(origin + apart)}) {
    const Ray ray{center + Eigen::Vector3d(0.3, 0.2, 10), {0, 0, -1}};
    const auto hit = caster.Cast({&ray, 1})[0];
    ASSERT_TRUE(hit);
    EXPECT_NEAR(hit->ray_t, 9, 1e-4);  // float at 1 km: 6e-5
  }
}

TEST(MeshTiles, TrianglesKnowTheirMeshAndItsFaces) {
  const auto folder = TestFolder();
  // A triangle without an area, a quadrilateral, a triangle; and a mesh of one triangle.
  WriteFile(folder / "a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 1 2\nf 1 2 3 4\nf 1 2 4\n");
  WriteFile(folder / "b.obj", "v 0 0 5\nv 1 0 5\nv 1 1 5\nf 1 2 3\n");
  const std::vector<std::filesystem::path> files = {folder / "a.obj", folder / "b.obj",
                                                    folder / "b.obj"};
  const TriangleMesh mesh = ReadMeshes(files);
  ASSERT_EQ(mesh.triangles.size(), 5u);
  const std::array<uint32_t, 5> faces = {1, 1, 2, 0, 0};
  const std::array<uint32_t, 5> objects = {0, 0, 0, 1, 2};
  for (uint32_t i = 0; i < 5; ++i) {
    EXPECT_EQ(mesh.FaceOf(i), faces[i]) << i;
    EXPECT_EQ(mesh.ObjectOf(i), objects[i]) << i;
  }
  const TriangleMesh two =
      MergeMeshes({MakeBox({0, 0, 0}, {1, 1, 1}), MakeBox({5, 0, 0}, {1, 1, 1})});
  EXPECT_TRUE(two.triangle_faces.empty());
  EXPECT_EQ(two.FaceOf(13), 1u);
  EXPECT_EQ(two.ObjectOf(13), 1u);
  EXPECT_EQ(two.ObjectOf(11), 0u);
}

// Of triangles that are removed and of tiles without names, none shifts the names of others; what
// readers have to say stays.
TEST(MeshTiles, TrianglesKeepTheirNames) {
  const auto folder = TestFolder();
  const std::string corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
  WriteFile(folder / "a.obj", corners +
                                  "f 1 2 3\nf 1 1 2\no wall\nusemtl brick\nf 1 1 3\nf 1 2 3\n"
                                  "g door\nf 1 3 4\no roof\nf 1 2 4\n");
  WriteFile(folder / "b.obj", corners + "f 1 2 3\n");
  WriteFile(folder / "c.obj", corners + "o wall\nusemtl tin\nf 1 3 4\n");
  const std::vector<std::filesystem::path> files = {folder / "a.obj", folder / "b.obj",
                                                    folder / "c.obj"};
  const TriangleMesh mesh = ReadMeshes(files);
  ASSERT_EQ(mesh.triangles.size(), 6u);
  constexpr uint32_t kNone = SurfaceLabel::kNone;
  const std::array<const char*, 6> names = {"", "wall", "wall/door", "roof/door", "", "wall"};
  const std::array<const char*, 6> materials = {"", "brick", "brick", "brick", "", "tin"};
  const std::array<uint32_t, 6> instances = {kNone, 0, 1, 2, kNone, 3};
  const std::array<uint32_t, 6> semantics = {kNone, 0, 0, 0, kNone, 1};
  for (uint32_t i = 0; i < 6; ++i) {
    EXPECT_EQ(mesh.LabelOf(i).instance_name, names[i]) << i;
    EXPECT_EQ(mesh.LabelOf(i).material, materials[i]) << i;
    EXPECT_EQ(mesh.LabelOf(i).instance, instances[i]) << i;
    EXPECT_EQ(mesh.LabelOf(i).semantic, semantics[i]) << i;
  }
  ASSERT_EQ(mesh.warnings.size(), 1u);
  EXPECT_NE(mesh.warnings[0].find("2 of 6 triangles removed"), std::string::npos);
}

TEST(MeshTiles, AttributesOfOneTileDoNotShiftThoseOfAnother) {
  TriangleMesh plain = MakeBox({0, 0, 0}, {1, 1, 1});
  TriangleMesh colored = MakeBox({5, 0, 0}, {1, 1, 1});
  colored.vertex_colors_rgb.assign(8, {1, 2, 3});
  colored.texture_coordinates.assign(8, {0.5f, 0.25f});
  colored.triangle_textures.assign(12, 0);
  colored.textures.push_back({1, 1, 3, {9, 9, 9}});
  const TriangleMesh merged = MergeMeshes({colored, plain, colored});
  EXPECT_EQ(merged.vertices.size(), 24u);
  EXPECT_EQ(merged.triangles.size(), 36u);
  EXPECT_EQ(merged.triangles[35][0], colored.triangles[11][0] + 16);
  ASSERT_EQ(merged.vertex_colors_rgb.size(), 24u);
  EXPECT_EQ(merged.vertex_colors_rgb[8], (std::array<uint8_t, 3>{255, 255, 255}));
  EXPECT_EQ(merged.vertex_colors_rgb[16], (std::array<uint8_t, 3>{1, 2, 3}));
  EXPECT_EQ(merged.texture_coordinates.size(), 24u);
  EXPECT_EQ(merged.triangle_textures[0], 0);
  EXPECT_EQ(merged.triangle_textures[12], -1);
  EXPECT_EQ(merged.triangle_textures[24], 1);
  EXPECT_EQ(merged.textures.size(), 2u);
}

TEST(MeshTiles, FilesAreNamedByListPatternOrFolder) {
  const auto folder = TestFolder();
  const std::string triangle = "v -1 -1 2\nv 1 -1 2\nv 0 1 2\nf 1 2 3\n";
  for (const char* name : {"b.obj", "a.obj", "c+d.obj", "notes.txt"}) {
    WriteFile(folder / name, triangle);
  }
  const std::string dir = folder.string();
  using Files = std::vector<std::filesystem::path>;
  EXPECT_EQ(ListMeshFiles(dir), (Files{folder / "a.obj", folder / "b.obj", folder / "c+d.obj"}));
  EXPECT_EQ(ListMeshFiles(dir + "/b.obj+" + dir + "/a.obj"),
            (Files{folder / "b.obj", folder / "a.obj"}));
  EXPECT_EQ(ListMeshFiles(dir + "/?.obj"), (Files{folder / "a.obj", folder / "b.obj"}));
  EXPECT_EQ(ListMeshFiles(dir + "/c+d.obj"), (Files{folder / "c+d.obj"}));
  EXPECT_EQ(ReadMeshes(ListMeshFiles(dir)).triangles.size(), 3u);
  EXPECT_TRUE(
      FailsWithInputError([&] { ListMeshFiles(dir + "/*.ply"); }, {"*.ply", "no mesh file"}));
  std::filesystem::create_directory(folder / "empty");
  EXPECT_TRUE(FailsWithInputError([&] { ListMeshFiles(dir + "/empty"); },
                                  {"empty", "expected mesh files"}));
  EXPECT_TRUE(FailsWithInputError([&] { ReadMeshes(ListMeshFiles(dir + "/a.obj+x.obj")); },
                                  {"x.obj", "no such file"}));
}

}  // namespace
}  // namespace raylift
