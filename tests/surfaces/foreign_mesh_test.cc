// ReadMesh on the formats that assimp reads, and on what assimp's exporters write.

#include <array>
#include <cstring>

#include "mesh_files.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <Eigen/Geometry>
#include <assimp/Exporter.hpp>
#include <assimp/Importer.hpp>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/surfaces/mesh_files.h"

#if defined(__SANITIZE_ADDRESS__)
// assimp leaks where it gives up on a file. The sanitizer's library looks for this by its name.
extern "C" __attribute__((visibility("default"))) const char* __lsan_default_suppressions() {
  return "leak:libassimp";
}
#endif

namespace raylift {
namespace {

// A GLB of one textured triangle (0 0 0, 1 0 0, 0 1 0) under a node that scales by 2 and moves by
// (10, 20, 30), and, under a child that mirrors x, the same once more without texture, in a color.
std::string MakeGlb() {
  std::string bin;
  for (const float value : {0, 0, 0, 1, 0, 0, 0, 1, 0}) AppendBytes(bin, value);  // positions
  for (const float value : {0.0f, 0.0f, 1.0f, 0.25f, 0.5f, 1.0f}) AppendBytes(bin, value);
  for (const uint16_t value : {0, 1, 2, 0}) AppendBytes(bin, value);
  const std::string png = TestPicturePng();
  const size_t png_at = bin.size();
  bin += png;
  while (bin.size() % 4 != 0) bin += '\0';
  const std::string json = fmt::format(
      R"({{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
"nodes":[{{"mesh":0,"scale":[2,2,2],"translation":[10,20,30],"children":[1]}},{{"mesh":1,"scale":[-1,1,1]}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"indices":2,"material":0}}]}},
{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":2,"material":1}}]}}],
"materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}},
{{"pbrMetallicRoughness":{{"baseColorFactor":[1,0,0.21404114,1]}}}}],
"textures":[{{"source":0}}],"images":[{{"bufferView":3,"mimeType":"image/png"}}],
"buffers":[{{"byteLength":{}}}],
"bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":24}},
{{"buffer":0,"byteOffset":60,"byteLength":6}},{{"buffer":0,"byteOffset":{},"byteLength":{}}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
{{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}},
{{"bufferView":2,"componentType":5123,"count":3,"type":"SCALAR"}}]}})",
      bin.size(), png_at, png.size());
  return GlbOf(json, bin);
}

TEST(ReadGlb, NodesTexturesAndColorsAreApplied) {
  const auto path = TestFolder() / "mesh.glb";
  WriteFile(path, MakeGlb());
  const TriangleMesh mesh = ReadMesh(path);
  EXPECT_TRUE(mesh.warnings.empty());
  // The mirrored triangle is turned round, so that its winding still says its outside.
  EXPECT_LT(
      MaxCornerDistance(
          mesh,
          {{10, 20, 30}, {12, 20, 30}, {10, 22, 30}, {10, 20, 30}, {10, 22, 30}, {8, 20, 30}}),
      1e-6);
  ASSERT_EQ(mesh.textures.size(), 1u);
  EXPECT_EQ(mesh.textures[0].data, TestPicture().data);
  EXPECT_EQ(mesh.triangle_textures, (std::vector<int32_t>{0, -1}));
  // glTF counts v from the first row.
  EXPECT_EQ(mesh.texture_coordinates[mesh.triangles[0][0]], Eigen::Vector2f(0, 1));
  EXPECT_EQ(mesh.texture_coordinates[mesh.triangles[0][1]], Eigen::Vector2f(1, 0.75f));
  EXPECT_EQ(mesh.texture_coordinates[mesh.triangles[0][2]], Eigen::Vector2f(0.5f, 0));
  for (const uint32_t index : mesh.triangles[1]) {
    EXPECT_EQ(mesh.vertex_colors_rgb[index], (std::array<uint8_t, 3>{255, 0, 128}));
  }
}

// A quad of 30 units under a node far from the origin, with what stands in the places of a glTF
// file.
std::string MakeFarQuad(const std::string& root, const std::string& node,
                        const std::string& material) {
  return fmt::format(
      R"({{"asset":{{"version":"2.0"}},{}"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,{}}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"indices":2,"material":0}}]}}],
"materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0{}}}}}}}],
"textures":[{{"source":0}}],"images":[{{"uri":"picture.png"}}],
"buffers":[{{"byteLength":92,"uri":"quad.bin"}}],
"bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":32}},
{{"buffer":0,"byteOffset":80,"byteLength":12}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[30,30,0]}},
{{"bufferView":1,"componentType":5126,"count":4,"type":"VEC2"}},
{{"bufferView":2,"componentType":5123,"count":6,"type":"SCALAR"}}]}})",
      root, node, material);
}

std::filesystem::path WriteFarQuad(const std::string& name, const std::string& gltf) {
  std::string bin;
  for (const float value : {0, 0, 0, 30, 0, 0, 30, 30, 0, 0, 30, 0}) AppendBytes(bin, value);
  for (const float value : {0, 0, 1, 0, 1, 1, 0, 1}) AppendBytes(bin, value);
  for (const uint16_t value : {0, 1, 2, 0, 2, 3}) AppendBytes(bin, value);
  const auto folder = TestFolder();
  WriteFile(folder / "quad.bin", bin);
  WriteFile(folder / "picture.png", TestPicturePng());
  WriteFile(folder / name, gltf);
  return folder / name;
}

// A scene from elsewhere shows no file of this machine.
TEST(ReadGltf, FilesOutsideOfItsFolderAreRefused) {
  const std::string gltf = MakeFarQuad("", R"("translation":[0,0,0])", "");
  for (const std::string file : {"quad.bin", "picture.png"}) {
    for (const std::string& place : {"../" + file, "/etc/" + file, "a/%2e%2E/../" + file,
                                     "file:///etc/" + file, "..\\\\" + file}) {
      std::string moved = gltf;
      moved.replace(moved.find(file), file.size(), place);
      const std::string list = file == "quad.bin" ? "buffers" : "images";
      EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(WriteFarQuad("far.gltf", moved)); },
                                      {"far.gltf: " + list + "[0].uri: expected a file below"}))
          << place;
    }
  }
}

// Earth-centered coordinates, whose steps as floats are of half a unit.
TEST(ReadGltf, NodesFarFromTheOriginKeepTheirPlace) {
  for (const std::string place :
       {R"("translation":[3919871.1,749219.2,4957101.3])",
        R"("matrix":[1,0,0,0,0,1,0,0,0,0,1,0,3919871.1,749219.2,4957101.3,1])"}) {
    const TriangleMesh mesh = ReadMesh(WriteFarQuad("far.gltf", MakeFarQuad("", place, "")));
    const auto corner = [&](size_t k) { return mesh.VertexInWorld(mesh.triangles[0][k]); };
    EXPECT_NEAR((corner(1) - corner(0)).norm(), 30, 1e-5);
    EXPECT_LT((corner(0) - Eigen::Vector3d(3919871.1, 749219.2, 4957101.3)).norm(), 1e-5);
  }
}

TEST(ReadGltf, RequiredExtensionsThatAreNotReadAreNamed) {
  const auto path = WriteFarQuad(
      "required.gltf",
      MakeFarQuad(R"("extensionsRequired":["EXT_unheard_of"],)", R"("scale":[1,1,1])", ""));
  EXPECT_TRUE(
      FailsWithInputError([&] { ReadMesh(path); }, {path.string(), "requires EXT_unheard_of"}));
  ReadMesh(WriteFarQuad(
      "unlit.gltf",
      MakeFarQuad(R"("extensionsRequired":["KHR_materials_unlit"],)", R"("scale":[1,1,1])", "")));
}

// A quarter turn, counter-clockwise as one looks at a picture, takes (1, 0) to (0, -1) where v goes
// down.
TEST(ReadGltf, TextureTransformsAreApplied) {
  const TriangleMesh mesh = ReadMesh(WriteFarQuad(
      "uv.gltf", MakeFarQuad("", R"("scale":[1,1,1])",
                             R"(,"extensions":{"KHR_texture_transform":{"offset":[0.25,0.5],)"
                             R"("rotation":1.5707963267948966,"scale":[0.5,1]}})")));
  const auto uv_down = [&](size_t k) -> Eigen::Vector2f {
    const Eigen::Vector2f uv = mesh.texture_coordinates[mesh.triangles[0][k]];
    return {uv.x(), 1 - uv.y()};
  };
  EXPECT_LT((uv_down(0) - Eigen::Vector2f(0.25f, 0.5f)).norm(), 1e-6);
  EXPECT_LT((uv_down(1) - Eigen::Vector2f(0.25f, 0.0f)).norm(), 1e-6);
  EXPECT_LT((uv_down(2) - Eigen::Vector2f(1.25f, 0.0f)).norm(), 1e-6);
}

TEST(ReadGlb, APictureBesideItIsNamedByAUri) {
  const auto path = TestFolder() / "mesh.glb";
  std::string glb = MakeGlb();
  const std::string inside = R"({"bufferView":3,"mimeType":"image/png"})";
  std::string beside = R"({"uri":"a%20b.png")";
  beside.resize(inside.size() - 1, ' ');
  glb.replace(glb.find(inside), inside.size(), beside + '}');
  WriteFile(path, glb);
  WriteFile(path.parent_path() / "a b.png", TestPicturePng());
  const TriangleMesh mesh = ReadMesh(path);
  EXPECT_TRUE(mesh.warnings.empty());
  ASSERT_EQ(mesh.textures.size(), 1u);
  EXPECT_EQ(mesh.textures[0].data, TestPicture().data);
}

TEST(ReadGlb, TruncatedFilesNeverCrash) {
  EXPECT_EQ(ReadTruncated(TestFolder() / "cut.glb", MakeGlb(), 7), 0);
}

constexpr char kStl[] =
    "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
    "endfacet\nendsolid s\n";

std::string BinaryStl() {
  std::string bytes(80, ' ');
  AppendBytes(bytes, uint32_t{2});
  for (const float z : {0.0f, 5.0f}) {
    for (const float value : {0.0f, 0.0f, 1.0f, 0.0f, 0.0f, z, 1.0f, 0.0f, z, 0.0f, 1.0f, z}) {
      AppendBytes(bytes, value);
    }
    AppendBytes(bytes, uint16_t{0});
  }
  return bytes;
}

TEST(ReadStl, TextAndBinaryAreRead) {
  const auto folder = TestFolder();
  WriteFile(folder / "text.stl", kStl);
  EXPECT_LT(MaxCornerDistance(ReadMesh(folder / "text.stl"), {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}),
            1e-9);
  WriteFile(folder / "binary.stl", BinaryStl());
  EXPECT_LT(MaxCornerDistance(ReadMesh(folder / "binary.stl"),
                              {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 5}, {1, 0, 5}, {0, 1, 5}}),
            1e-9);
}

TEST(ReadStl, TruncatedFilesNeverCrash) {
  const auto path = TestFolder() / "cut.stl";
  ReadTruncated(path, kStl, 3);
  ReadTruncated(path, BinaryStl(), 3);
}

TEST(ReadForeignMesh, GarbageAndUnknownFormatsAreInputErrors) {
  const auto folder = TestFolder();
  std::string garbage;
  Rng rng = TestRng();
  for (int i = 0; i < 5000; ++i) garbage += static_cast<char>(rng.UniformIndex(256));
  for (const std::string name : {"a.ply", "a.obj", "a.glb", "a.gltf", "a.stl", "a.dae", "a.fbx",
                                 "a.off", "a.xyz", "noextension"}) {
    WriteFile(folder / name, garbage);
    EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(folder / name); }, {name})) << name;
    WriteFile(folder / name, "");
    EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(folder / name); }, {name})) << name;
  }
}

// Sums that do not depend on the order of triangles and corners, which writers change.
struct Digest {
  double area = 0;
  Eigen::Vector3d normals = Eigen::Vector3d::Zero();    // by where they are: sees the winding
  Eigen::Vector2d uv_moment = Eigen::Vector2d::Zero();  // sees which corner has which
};

Digest MakeDigest(const TriangleMesh& mesh) {
  const Eigen::Vector3d weights(1, 2, 3);
  Digest digest;
  for (const auto& triangle : mesh.triangles) {
    const Eigen::Vector3d a = mesh.VertexInWorld(triangle[0]);
    const Eigen::Vector3d b = mesh.VertexInWorld(triangle[1]);
    const Eigen::Vector3d c = mesh.VertexInWorld(triangle[2]);
    const Eigen::Vector3d normal = 0.5 * (b - a).cross(c - a);
    digest.area += normal.norm();
    digest.normals += normal * (a + b + c + weights).squaredNorm();
    for (const uint32_t index : triangle) {
      if (mesh.texture_coordinates.empty()) break;
      digest.uv_moment +=
          mesh.VertexInWorld(index).dot(weights) * mesh.texture_coordinates[index].cast<double>();
    }
  }
  return digest;
}

// A box of triangles, textured, every side's texture coordinates other ones.
std::string CubeObj() {
  std::string obj = "mtllib cube.mtl\nusemtl wall\n";
  for (int i = 0; i < 8; ++i) {
    obj += fmt::format("v {} {} {}\n", i & 1, (i >> 1 & 1) * 2, (i >> 2 & 1) * 3);
  }
  for (int i = 0; i < 24; ++i) obj += fmt::format("vt {} {}\n", i % 5 * 0.2, i % 7 * 0.125);
  const std::array<std::array<int, 4>, 6> sides = {
      {{1, 3, 4, 2}, {5, 6, 8, 7}, {1, 2, 6, 5}, {3, 7, 8, 4}, {1, 5, 7, 3}, {2, 4, 8, 6}}};
  int uv = 0;
  for (const auto& side : sides) {
    const auto& [a, b, c, d] = side;
    obj += fmt::format("f {}/{} {}/{} {}/{}\n", a, uv + 1, b, uv + 2, c, uv + 3);
    obj += fmt::format("f {}/{} {}/{} {}/{}\n", a, uv + 1, c, uv + 3, d, uv + 4);
    uv += 4;
  }
  return obj;
}

TEST(ReadForeignMesh, AgreesWithWhatAssimpWritesInEachFormat) {
  const auto folder = TestFolder();
  WriteFile(folder / "wall.png", TestPicturePng());
  WriteFile(folder / "cube.mtl", "newmtl wall\nKd 1 1 1\nmap_Kd wall.png\n");
  WriteFile(folder / "cube.obj", CubeObj());
  const TriangleMesh original = ReadMesh(folder / "cube.obj");
  EXPECT_EQ(original.triangles.size(), 12u);
  const Digest expected = MakeDigest(original);
  EXPECT_NEAR(expected.area, 22, 1e-9);

  Assimp::Importer importer;
  const aiScene* scene = importer.ReadFile((folder / "cube.obj").string(), aiProcess_Triangulate);
  ASSERT_NE(scene, nullptr);
  Assimp::Exporter exporter;
  struct Format {
    const char* id;
    const char* file;
    bool has_uvs;
    bool has_texture;
  };
  for (const Format& format :
       {Format{"ply", "text.ply", true, false}, Format{"plyb", "binary.ply", true, false},
        Format{"obj", "again.obj", true, true}, Format{"stl", "text.stl", false, false},
        Format{"stlb", "binary.stl", false, false}, Format{"glb2", "binary.glb", true, true},
        Format{"gltf2", "text.gltf", true, true}, Format{"collada", "mesh.dae", true, true},
        Format{"fbxa", "mesh.fbx", true, true}}) {
    const auto path = folder / format.file;
    ASSERT_EQ(exporter.Export(scene, format.id, path.string()), aiReturn_SUCCESS) << format.id;
    const TriangleMesh mesh = ReadMesh(path);
    EXPECT_EQ(mesh.triangles.size(), 12u) << format.id;
    const Digest digest = MakeDigest(mesh);
    EXPECT_NEAR(digest.area, expected.area, 1e-5) << format.id;
    if (format.has_texture) {
      ASSERT_EQ(mesh.textures.size(), 1u) << format.id;
      EXPECT_EQ(mesh.textures[0].data, TestPicture().data) << format.id;
      EXPECT_EQ(mesh.triangle_textures, std::vector<int32_t>(12, 0)) << format.id;
    }
    EXPECT_LT((digest.normals - expected.normals).norm(), 1e-4) << format.id;
    if (format.has_uvs) {
      EXPECT_LT((digest.uv_moment - expected.uv_moment).norm(), 1e-4) << format.id;
    }
  }
}

}  // namespace
}  // namespace raylift
