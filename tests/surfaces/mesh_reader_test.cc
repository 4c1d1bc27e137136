// What ReadMesh does for every format.

#include <cmath>

#include "mesh_files.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <fmt/format.h>
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

// A grid of 20 cm at the place of a town in UTM coordinates.
TEST(ReadMesh, FloatsTooCoarseForTheirPlaceAreAnError) {
  constexpr int kSide = 40;
  const auto write = [](const std::string& name, const std::string& type) {
    std::string ply = fmt::format(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty {} x\nproperty {} y\nproperty {} z\n"
        "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        kSide * kSide, type, type, type, 2 * (kSide - 1) * (kSide - 1));
    for (int i = 0; i < kSide * kSide; ++i) {
      const double x = 4.1e5 + 0.2 * (i % kSide), y = 5.3e6 + 0.2 * (i / kSide);
      ply += type == "float" ? fmt::format("{} {} 50\n", double{static_cast<float>(x)},
                                           double{static_cast<float>(y)})
                             : fmt::format("{} {} 50\n", x, y);
    }
    for (int y = 0; y + 1 < kSide; ++y) {
      for (int x = 0; x + 1 < kSide; ++x) {
        const int a = y * kSide + x, b = a + kSide;
        ply += fmt::format("3 {} {} {}\n3 {} {} {}\n", a, a + 1, b, a + 1, b + 1, b);
      }
    }
    const auto path = TestFolder() / name;
    WriteFile(path, ply);
    return path;
  };
  EXPECT_EQ(ReadMesh(write("double.ply", "double")).triangles.size(), 2u * 39 * 39);
  const auto coarse = write("float.ply", "float");
  EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(coarse); },
                                  {coarse.string(), "lost their area", "shift="}));
}

}  // namespace
}  // namespace raylift
