#include "support/meshes.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

void ExpectReadsTheSame(const TriangleMesh& mesh) {
  const std::filesystem::path file = TestFolder() / "mesh.ply";
  WritePly(file, mesh);
  const TriangleMesh read = ReadMesh(file);
  EXPECT_EQ(read.triangles, mesh.triangles);
  EXPECT_EQ(read.vertex_colors_rgb, mesh.vertex_colors_rgb);
  ASSERT_EQ(read.vertices.size(), mesh.vertices.size());
  for (uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    EXPECT_LT((read.VertexInWorld(v) - mesh.VertexInWorld(v)).norm(), 1e-6);
  }
}

TEST(WritePly, IsReadAsItWas) {
  TriangleMesh mesh = MakeSphere({0.1, 0.2, 0.3}, 2, 8, 12);
  ExpectReadsTheSame(mesh);
  for (size_t v = 0; v < mesh.vertices.size(); ++v) {
    mesh.vertex_colors_rgb.push_back({static_cast<uint8_t>(v), 7, 255});
  }
  ExpectReadsTheSame(mesh);
}

TEST(WritePly, KeepsCoordinatesOfAMapProjection) {
  TriangleMesh mesh = MakeBox({4.5e5, 5.4e6, 300}, {1, 2, 3});
  ExpectReadsTheSame(mesh);
}

}  // namespace
}  // namespace raylift
