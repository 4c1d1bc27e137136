#include <cmath>

#include "surfaces/resampled_mesh.h"
#include <gtest/gtest.h>

#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

constexpr int kSteps = 60;

// A bent sheet, z = x^2, over the unit square; x is red, y is green.
TriangleMesh Sheet() {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<std::array<uint8_t, 3>> colors;
  std::vector<std::array<uint32_t, 3>> triangles;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const double x = static_cast<double>(i) / kSteps, y = static_cast<double>(j) / kSteps;
      vertices.emplace_back(x + 1e5, y, x * x);
      colors.push_back({static_cast<uint8_t>(200 * x), static_cast<uint8_t>(200 * y), 0});
    }
  }
  for (uint32_t i = 0; i < kSteps; ++i) {
    for (uint32_t j = 0; j < kSteps; ++j) {
      const uint32_t a = i * (kSteps + 1) + j, b = a + kSteps + 1;
      triangles.push_back({a, b, b + 1});
      triangles.push_back({a, b + 1, a + 1});
    }
  }
  return MakeMesh(std::move(vertices), std::move(triangles), std::move(colors));
}

double Area(const TriangleMesh& mesh) {
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    area += 0.5 * (mesh.VertexInWorld(b) - mesh.VertexInWorld(a))
                      .cross(mesh.VertexInWorld(c) - mesh.VertexInWorld(a))
                      .norm();
  }
  return area;
}

TEST(DecimatedMesh, KeepsPlaceAreaAndColorsWithFewTriangles) {
  const TriangleMesh mesh = Sheet();
  const TriangleMesh coarse = DecimatedMesh(mesh, 800);
  EXPECT_LE(coarse.triangles.size(), 800u);
  EXPECT_GT(coarse.triangles.size(), 600u);
  // Cells have a side of some 0.06 here: vertices stay on the sheet up to its bend in a cell, and
  // the sheet loses half a cell at each border.
  for (uint32_t i = 0; i < coarse.vertices.size(); ++i) {
    const Eigen::Vector3d vertex = coarse.VertexInWorld(i) - Eigen::Vector3d(1e5, 0, 0);
    EXPECT_NEAR(vertex.z(), vertex.x() * vertex.x(), 0.002);
    EXPECT_NEAR(coarse.vertex_colors_rgb[i][0], 200 * vertex.x(), 2);
    EXPECT_NEAR(coarse.vertex_colors_rgb[i][1], 200 * vertex.y(), 2);
  }
  EXPECT_NEAR(Area(coarse) / Area(mesh), 1, 0.15);
  // All triangles are still wound the same way.
  for (const auto& [a, b, c] : coarse.triangles) {
    const Eigen::Vector3f normal =
        (coarse.vertices[b] - coarse.vertices[a]).cross(coarse.vertices[c] - coarse.vertices[a]);
    EXPECT_GE(normal.z(), 0);
  }
}

TEST(DecimatedMesh, FewTrianglesStayAsTheyAre) {
  const TriangleMesh mesh = Sheet();
  const TriangleMesh same = DecimatedMesh(mesh, mesh.triangles.size());
  EXPECT_EQ(same.triangles, mesh.triangles);
  EXPECT_EQ(same.vertices, mesh.vertices);
}

TEST(DecimatedMesh, TexturesBecomeColors) {
  TriangleMesh mesh = Sheet();
  mesh.vertex_colors_rgb.clear();
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    mesh.texture_coordinates.emplace_back(vertex.x() - mesh.vertices[0].x(),
                                          vertex.y() - mesh.vertices[0].y());
  }
  mesh.triangle_textures.assign(mesh.triangles.size(), 0);
  // Bright where v is high, which is above in the picture.
  Image picture{64, 64, 3, std::vector<uint8_t>(64 * 64 * 3, 50)};
  std::fill_n(picture.data.begin(), 64 * 32 * 3, 220);
  mesh.textures = {picture};
  const TriangleMesh coarse = DecimatedMesh(mesh, 800);
  EXPECT_TRUE(coarse.textures.empty());
  ASSERT_EQ(coarse.vertex_colors_rgb.size(), coarse.vertices.size());
  for (uint32_t i = 0; i < coarse.vertices.size(); ++i) {
    const double y = coarse.VertexInWorld(i).y();
    // Away from the step and from the border, where the picture repeats.
    const bool above = y > 0.65 && y<0.85, below = y> 0.15 && y < 0.35;
    if (!above && !below) continue;
    EXPECT_NEAR(coarse.vertex_colors_rgb[i][0], above ? 220 : 50, 2) << y;
  }
}

}  // namespace
}  // namespace raylift
