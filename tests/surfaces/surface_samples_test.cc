#include "surfaces/resampled_mesh.h"
#include <gtest/gtest.h>

#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

TEST(SampleSurface, DrawsEvenlyOverTheArea) {
  // Right triangles of areas 1/2 and 2, the second one at height 1 and seen from below.
  const TriangleMesh mesh = MakeMesh(
      {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 2, 1}, {2, 0, 1}}, {{0, 1, 2}, {3, 4, 5}});
  constexpr size_t kCount = 20000;
  const std::vector<SurfaceSample> samples = SampleSurface(mesh, kCount, 1);
  ASSERT_EQ(samples.size(), kCount);
  double above = 0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();  // of the samples above
  for (const auto& [point, normal] : samples) {
    const bool is_above = point.z() > 0.5;
    const double side = is_above ? 2 : 1;
    EXPECT_GE(point.head<2>().minCoeff(), 0);
    EXPECT_LE(point.x() + point.y(), side + 1e-6);
    EXPECT_EQ(point.z(), is_above ? 1 : 0);
    EXPECT_EQ(normal, Eigen::Vector3d(0, 0, is_above ? -1 : 1));
    if (!is_above) continue;
    above += 1;
    sum += point;
  }
  // Four fifths of the area, and its centroid, within four standard deviations.
  EXPECT_NEAR(above / kCount, 0.8, 0.012);
  EXPECT_NEAR(sum.x() / above, 2.0 / 3, 0.015);
  EXPECT_NEAR(sum.y() / above, 2.0 / 3, 0.015);
}

TEST(SampleSurface, HasNoneOfAMeshWithoutArea) {
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  mesh.triangles = {{0, 1, 2}};
  EXPECT_TRUE(SampleSurface(mesh, 10, 0).empty());
}

}  // namespace
}  // namespace raylift
