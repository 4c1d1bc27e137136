// What ReadMesh does for every format.

#include <cmath>

#include "mesh_files.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

TEST(ReadMesh, MissingFilesAndFoldersAreNamed) {
  for (const std::string name : {"/nowhere/mesh.ply", "/nowhere/mesh.obj", "/nowhere/mesh.glb"}) {
    EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(name); }, {name, "no such file"}));
  }
  const auto folder = TestFolder();
  EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(folder); }, {folder.string(), "folder"}));
}

TEST(ReadMesh, ExtensionsAreReadInAnyCase) {
  const auto path = TestFolder() / "MESH.OBJ";
  WriteFile(path, "v 400000.0123 0 0\nv 400001 0 0\nv 400000 1 0\nf 1 2 3\n");
  EXPECT_NEAR(Corners(ReadMesh(path))[0].x(), 400000.0123, 1e-7);
}

TEST(ReadMesh, FloatCoordinatesAreKeptExactly) {
  // Whatever the origin that is subtracted, floats of a file come back as they were.
  Rng rng = TestRng();
  for (const double center : {0.0, 3.0, 1e3, 4e5, 5e6}) {
    std::vector<Eigen::Vector3d> expected;
    for (int i = 0; i < 300; ++i) {
      Eigen::Vector3d p;
      for (int c = 0; c < 3; ++c) {
        p[c] = static_cast<double>(static_cast<float>(center + rng.Uniform(-9, 9)));
      }
      expected.push_back(p);
    }
    const auto path = TestFolder() / "floats.ply";
    std::string ply =
        "ply\nformat binary_little_endian 1.0\nelement vertex 300\nproperty float x\nproperty "
        "float y\n"
        "property float z\nelement face 100\nproperty list uchar int vertex_indices\nend_header\n";
    for (const Eigen::Vector3d& p : expected) {
      for (int c = 0; c < 3; ++c) AppendBytes(ply, static_cast<float>(p[c]));
    }
    for (int32_t face = 0; face < 100; ++face) {
      AppendBytes(ply, uint8_t{3});
      for (int32_t k = 0; k < 3; ++k) AppendBytes(ply, 3 * face + k);
    }
    WriteFile(path, ply);
    const TriangleMesh mesh = ReadMesh(path);
    if (center == 0) {
      EXPECT_EQ(mesh.origin_in_world, Eigen::Vector3d::Zero());
    }
    if (center > 100) {
      EXPECT_LE(std::abs(mesh.origin_in_world.x() - center), 16);
    }
    EXPECT_EQ(MaxCornerDistance(mesh, expected), 0) << center;
  }
}

TEST(ReadMesh, ReadMeshesAreSharedWithEmbreeAsTheyAre) {
  const auto path = TestFolder() / "mesh.obj";
  WriteFile(path, "v 0 0 2\nv 1 0 2\nv 0 1 2\nf 1 2 3\n");
  const auto mesh = std::make_shared<const TriangleMesh>(ReadMesh(path));
  EXPECT_GT(mesh->vertices.capacity(), mesh->vertices.size());  // what RayCaster needs to share
  const Ray ray{{0.2, 0.2, 0}, {0, 0, 1}};
  EXPECT_TRUE(RayCaster(mesh).Cast({&ray, 1})[0]);
}

// A grid of 20 cm around a corner, in floats or doubles, as text or binary; with a triangle without
// an area after each row, which are more than one in a hundred.
template <typename Coordinate>
std::filesystem::path WriteGrid(const std::filesystem::path& path, double x0, double y0,
                                bool is_text) {
  constexpr int kSide = 40;
  constexpr int kTriangles = (kSide - 1) * (2 * (kSide - 1) + 1);
  const std::string_view type = sizeof(Coordinate) == 4 ? "float" : "double";
  std::string ply = fmt::format(
      "ply\nformat {} 1.0\nelement vertex {}\nproperty {} x\nproperty {} y\nproperty {} z\n"
      "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
      is_text ? "ascii" : "binary_little_endian", kSide * kSide, type, type, type, kTriangles);
  for (int i = 0; i < kSide * kSide; ++i) {
    const auto x = static_cast<Coordinate>(x0 + 0.2 * (i % kSide));
    const auto y = static_cast<Coordinate>(y0 + 0.2 * (i / kSide));
    if (is_text) {
      ply += fmt::format("{} {} 50\n", double{x}, double{y});
    } else {
      for (const Coordinate c : {x, y, Coordinate{50}}) AppendBytes(ply, c);
    }
  }
  const auto add = [&](int a, int b, int c) {
    if (is_text) {
      ply += fmt::format("3 {} {} {}\n", a, b, c);
      return;
    }
    AppendBytes(ply, uint8_t{3});
    for (const int corner : {a, b, c}) AppendBytes(ply, corner);
  };
  for (int y = 0; y + 1 < kSide; ++y) {
    for (int x = 0; x + 1 < kSide; ++x) {
      const int a = y * kSide + x, b = a + kSide;
      add(a, a + 1, b);
      add(a + 1, b + 1, b);
    }
    add(y, y, y + 1);
  }
  WriteFile(path, ply);
  return path;
}

TEST(ReadMesh, FloatsTooCoarseForTheirPlaceAreAnError) {
  const auto folder = TestFolder();
  constexpr double kEasting = 4.1e5, kNorthing = 5.3e6;  // of a town, in UTM coordinates
  for (const bool is_text : {true, false}) {
    const auto precise = WriteGrid<double>(folder / "double.ply", kEasting, kNorthing, is_text);
    EXPECT_EQ(ReadMesh(precise).triangles.size(), 2u * 39 * 39);
    const auto coarse = WriteGrid<float>(folder / "float.ply", kEasting, kNorthing, is_text);
    EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(coarse); },
                                    {coarse.string(), "lost their area", "shift="}));
    // Triangles that never had an area are no reason.
    EXPECT_EQ(ReadMesh(WriteGrid<float>(folder / "near.ply", 0, 0, is_text)).triangles.size(),
              2u * 39 * 39);
  }
}

// Also where so many triangles are left out that it might be rounding's doing.
TEST(ReadMesh, BinaryVerticesKeepTheirOrder) {
  const TriangleMesh mesh =
      ReadMesh(WriteGrid<float>(TestFolder() / "grid.ply", 0, 0, /*is_text=*/false));
  ASSERT_EQ(mesh.vertices.size(), 1600u);
  for (uint32_t i = 0; i < 1600; ++i) {
    EXPECT_NEAR(mesh.VertexInWorld(i).x(), 0.2 * (i % 40), 1e-5);
    EXPECT_NEAR(mesh.VertexInWorld(i).y(), 0.2 * (i / 40), 1e-5);
  }
  EXPECT_THAT(mesh.warnings, ::testing::ElementsAre(::testing::HasSubstr("39 of 3081 triangles")));
}

}  // namespace
}  // namespace raylift
