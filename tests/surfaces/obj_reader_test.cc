// ReadMesh on OBJ files and their materials.

#include <array>

#include "mesh_files.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using Rgb = std::array<uint8_t, 3>;

constexpr char kSquare[] =
    "# a square\r\nmtllib my materials.mtl\no square\n"
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nvt 0 0\nvt 1 0\nvt 1 1 0\nvt 0 1\n"
    "usemtl wall paper\nf 1/1/1 2/2/1 3/3/1\n"
    "usemtl plain\nf 1//1 3//1 4//1\n"
    "usemtl nowhere\ns off\nf -4/-4 -2/-2 -1/-1\n";

constexpr char kMaterials[] =
    "newmtl wall paper\nKa 1 1 1\nKd 0.5 0.5 0.5\nmap_Kd my wall.png\n\n"
    "newmtl plain\nKd 1 0.5 0\n";

TEST(ReadObj, TexturesAndColorsComeFromTheMaterials) {
  const auto folder = TestFolder();
  WriteFile(folder / "my wall.png", TestPicturePng());
  WriteFile(folder / "my materials.mtl", kMaterials);
  WriteFile(folder / "mesh.obj", kSquare);
  const TriangleMesh mesh = ReadMesh(folder / "mesh.obj");
  EXPECT_TRUE(mesh.warnings.empty());
  EXPECT_LT(MaxCornerDistance(mesh, {{0, 0, 0},
                                     {1, 0, 0},
                                     {1, 1, 0},
                                     {0, 0, 0},
                                     {1, 1, 0},
                                     {0, 1, 0},
                                     {0, 0, 0},
                                     {1, 1, 0},
                                     {0, 1, 0}}),
            1e-9);
  ASSERT_EQ(mesh.textures.size(), 1u);
  EXPECT_EQ(mesh.textures[0].data, TestPicture().data);
  EXPECT_EQ(mesh.triangle_textures, (std::vector<int32_t>{0, -1, -1}));
  EXPECT_EQ(mesh.texture_coordinates[mesh.triangles[0][1]], Eigen::Vector2f(1, 0));
  EXPECT_EQ(mesh.texture_coordinates[mesh.triangles[2][2]], Eigen::Vector2f(0, 1));
  for (const uint32_t index : mesh.triangles[1]) {
    EXPECT_EQ(mesh.vertex_colors_rgb[index], (Rgb{255, 128, 0}));
  }
}

TEST(ReadObj, TextureOptionsAndWindowsPathsAreUnderstood) {
  const auto folder = TestFolder();
  WriteFile(folder / "textures" / "wall.png", TestPicturePng());
  WriteFile(folder / "a.mtl", "newmtl a\nmap_Kd -s 1 1 1 -bm 0.5 textures\\wall.png\n");
  WriteFile(folder / "mesh.obj",
            "mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n");
  EXPECT_EQ(ReadMesh(folder / "mesh.obj").triangle_textures, std::vector<int32_t>{0});
}

TEST(ReadObj, FilesOutsideOfItsFolderAreNotRead) {
  const auto folder = TestFolder();
  const std::string outside = (folder / "wall.png").string();
  WriteFile(outside, TestPicturePng());
  WriteFile(folder / "a.mtl", "newmtl a\nmap_Kd wall.png\n");
  const std::string faces = "usemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n";
  const auto file = folder / "scene" / "mesh.obj";
  WriteFile(file, "mtllib ../a.mtl\n" + faces);
  EXPECT_TRUE(ReadMesh(file).textures.empty());
  for (const std::string& name :
       {std::string("../wall.png"), std::string("a/..\\..\\wall.png"), outside}) {
    WriteFile(folder / "scene" / "a.mtl", "newmtl a\nmap_Kd " + name + "\n");
    WriteFile(file, "mtllib a.mtl\n" + faces);
    const TriangleMesh mesh = ReadMesh(file);
    EXPECT_TRUE(mesh.textures.empty()) << name;
    ASSERT_EQ(mesh.warnings.size(), 1u) << name;
    EXPECT_NE(mesh.warnings[0].find("not below the mesh's folder"), std::string::npos);
  }
}

TEST(ReadObj, MissingMaterialsAndTexturesAreWarnings) {
  const auto folder = TestFolder();
  WriteFile(folder / "mesh.obj", kSquare);
  const TriangleMesh without_materials = ReadMesh(folder / "mesh.obj");
  EXPECT_EQ(without_materials.triangles.size(), 3u);
  ASSERT_FALSE(without_materials.warnings.empty());
  EXPECT_NE(without_materials.warnings[0].find("no such file"), std::string::npos);

  WriteFile(folder / "my materials.mtl", kMaterials);
  WriteFile(folder / "my wall.png", "this is no picture");
  const TriangleMesh without_texture = ReadMesh(folder / "mesh.obj");
  EXPECT_TRUE(without_texture.triangle_textures.empty());
  ASSERT_EQ(without_texture.warnings.size(), 1u);
  EXPECT_NE(without_texture.warnings[0].find("my wall.png: cannot be decoded"), std::string::npos);
}

TEST(ReadObj, CoordinatesAreReadInDouble) {
  const auto path = TestFolder() / "far.obj";
  WriteFile(path,
            "v 400000.0123 5000000.0456 300.0789\nv 400001.0123 5000000.0456 300.0789\n"
            "v 400000.0123 5000001.0456 300.0789\nf 1 2 3\n");
  const Eigen::Vector3d offset(400000.0123, 5000000.0456, 300.0789);
  EXPECT_LT(MaxCornerDistance(ReadMesh(path), {offset, offset + Eigen::Vector3d(1, 0, 0),
                                               offset + Eigen::Vector3d(0, 1, 0)}),
            1e-7);
}

TEST(ReadObj, VertexColorsAndConcavePolygonsAreRead) {
  const auto path = TestFolder() / "arrow.obj";
  WriteFile(path,
            "v 0 0 0 1 0 0\nv 2 1 0 0 1 0\nv 0 2 0 0 0 1\nv 1 1 0\nv 5 5 5 1 1 1\n"
            "f 1 2 3 4\n");
  const TriangleMesh mesh = ReadMesh(path);
  EXPECT_EQ(mesh.triangles.size(), 2u);
  EXPECT_NEAR(SurfaceArea(mesh), 1, 1e-6);  // a fan from the first corner would give 1, too, ...
  ASSERT_EQ(mesh.vertex_colors_rgb.size(), 4u);
  EXPECT_EQ(mesh.vertices.size(), 4u);  // the fifth belongs to no face

  WriteFile(path, "v 2 1 0\nv 0 2 0\nv 1 1 0\nv 0 0 0\nf 1 2 3 4\n");
  EXPECT_NEAR(SurfaceArea(ReadMesh(path)), 1, 1e-6);
  WriteFile(path, "v 0 2 0\nv 1 1 0\nv 0 0 0\nv 2 1 0\nf 1 2 3 4\n");
  EXPECT_NEAR(SurfaceArea(ReadMesh(path)), 1, 1e-6);  // ... but not from here
}

TEST(ReadObj, WrongValuesAreNamedWithTheirLine) {
  const auto path = TestFolder() / "bad.obj";
  const auto fails = [&](const std::string& contents, const std::vector<std::string>& parts) {
    WriteFile(path, contents);
    return FailsWithInputError([&] { ReadMesh(path); }, parts);
  };
  const std::string good = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  EXPECT_TRUE(fails("v 0 0\n", {"bad.obj", "line 1", "found 2 numbers"}));
  EXPECT_TRUE(fails("v 0 0 a\n", {"line 1", "z", "\"a\""}));
  EXPECT_TRUE(fails(good + "f 1 2 4\n", {"line 4", "face 1", "vertex index in 1..3", "\"4\""}));
  EXPECT_TRUE(fails(good + "f 1 2 3\nf 1 2 0\n", {"line 5", "face 2", "\"0\""}));
  EXPECT_TRUE(fails(good + "f 1 2 -4\n", {"line 4", "\"-4\""}));
  EXPECT_TRUE(fails(good + "f 1 2 x\n", {"line 4", "\"x\""}));
  EXPECT_TRUE(fails(good + "f 1/1 2/1 3/1\n", {"line 4", "texture coordinate index"}));
  EXPECT_TRUE(fails(good, {"point cloud: 3 vertices"}));
  EXPECT_TRUE(fails("", {"no vertices and no faces"}));
  EXPECT_TRUE(fails(good + "f 1 2\n", {"point cloud"}));
}

TEST(ReadObj, TrianglesThatCannotBeHitAreRemovedAndCounted) {
  const auto path = TestFolder() / "dirty.obj";
  WriteFile(path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nf 1 2 3\nf 1 2 4\nf 1 1 2\nf 1 2\n");
  const TriangleMesh mesh = ReadMesh(path);
  EXPECT_EQ(mesh.triangles.size(), 1u);
  EXPECT_EQ(mesh.warnings.size(), 3u);
}

TEST(ReadObj, TruncatedFilesNeverCrash) {
  const auto folder = TestFolder();
  WriteFile(folder / "my wall.png", TestPicturePng());
  WriteFile(folder / "my materials.mtl", kMaterials);
  EXPECT_GT(ReadTruncated(folder / "cut.obj", kSquare), 0);  // whole faces are a mesh
  WriteFile(folder / "cut.obj", kSquare);
  const std::string materials = kMaterials;
  for (size_t size = 0; size < materials.size(); ++size) {
    WriteFile(folder / "my materials.mtl", materials.substr(0, size));
    try {
      ReadMesh(folder / "cut.obj");
    } catch (const std::exception& error) {
      EXPECT_NE(std::string(error.what()).find("my materials.mtl: line"), std::string::npos);
    }
  }
}

}  // namespace
}  // namespace raylift
