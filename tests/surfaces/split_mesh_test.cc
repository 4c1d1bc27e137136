#include <map>
#include <utility>

#include "support/meshes.h"
#include "surfaces/resampled_mesh.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

using Eigen::Vector3d;

TEST(SplitLongEdges, KeepsTheSurface) {
  TriangleMesh box = MakeBox({1, 2, 3}, {1, 0.5, 2});
  box.object_begins = {0, 4};
  box.labels.resize(2);
  for (uint32_t i = 0; i < 2; ++i) box.labels[i].instance = i;
  for (uint32_t t = 0; t < 12; ++t) box.triangle_labels.push_back(t < 4 ? 0 : 1);
  const TriangleMesh fine = SplitLongEdges(box, 0.3);
  double area = 0;
  for (uint32_t t = 0; t < fine.triangles.size(); ++t) {
    const auto& [a, b, c] = fine.triangles[t];
    for (const auto& [from, to] : {std::pair(a, b), std::pair(b, c), std::pair(c, a)}) {
      EXPECT_LE((fine.vertices[from] - fine.vertices[to]).norm(), 0.3f);
    }
    const Eigen::Vector3f normal =
        (fine.vertices[b] - fine.vertices[a]).cross(fine.vertices[c] - fine.vertices[a]);
    area += 0.5 * normal.norm();
    // Outward as before, and of the same object and face.
    const Vector3d center = fine.VertexInWorld(a) - Vector3d(1, 2, 3);
    EXPECT_GT(normal.cast<double>().dot(center), 0);
    EXPECT_LT(fine.FaceOf(t), fine.ObjectOf(t) == 0 ? 4u : 8u);
    EXPECT_EQ(fine.LabelOf(t).instance, fine.ObjectOf(t));
  }
  EXPECT_NEAR(area, 2 * (2 * 1 + 2 * 4 + 1 * 4), 1e-4);
  EXPECT_EQ(fine.ObjectOf(0), 0u);
  EXPECT_EQ(fine.ObjectOf(static_cast<uint32_t>(fine.triangles.size()) - 1), 1u);
  // Closed as before: each edge belongs to two triangles, in both directions.
  std::map<std::pair<uint32_t, uint32_t>, int> edges;
  for (const auto& [a, b, c] : fine.triangles) {
    ++edges[{a, b}];
    ++edges[{b, c}];
    ++edges[{c, a}];
  }
  if (box.vertices.size() == 8) {
    for (const auto& [edge, count] : edges) {
      EXPECT_EQ(count, 1);
      EXPECT_EQ(edges.count({edge.second, edge.first}), 1u);
    }
  }
}

}  // namespace
}  // namespace raylift
