#include "raylift/comparison/surface_distance.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "support/meshes.h"

#include "raylift/base/rng.h"

namespace raylift {
namespace {

TEST(SurfaceTree, ABoxIsAsFarAsItsFormulaSays) {
  const Eigen::Vector3d center(1e6, 2, 3), half(1, 2, 3);
  const SurfaceTree tree(MakeBox(center, half));
  Rng rng(StreamSeed(0, "SurfaceTree.ABoxIsAsFarAsItsFormulaSays", ""));
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3d p(rng.Uniform(-5, 5), rng.Uniform(-5, 5), rng.Uniform(-5, 5));
    const Eigen::Vector3d beyond = p.cwiseAbs() - half;
    const double outside = beyond.cwiseMax(0).norm();
    const double expected = outside > 0 ? outside : -beyond.maxCoeff();
    // Vertices are float, relative to an origin near them.
    EXPECT_NEAR(tree.Distance(center + p, 100), expected, 1e-5);
  }
  EXPECT_EQ(tree.Distance(center + Eigen::Vector3d(50, 0, 0), 2), 2);
}

TEST(SurfaceTree, PointsAreFoundLikeByLookingAtAllOfThem) {
  Rng rng(StreamSeed(0, "SurfaceTree.Points", ""));
  const auto draw = [&] { return Eigen::Vector3d(rng.Uniform(), rng.Uniform(), rng.Uniform()); };
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 500; ++i) points.push_back(draw());
  const SurfaceTree tree(points);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p = draw();
    double best = 1;
    for (const auto& q : points) best = std::min(best, (p - q).norm());
    EXPECT_NEAR(tree.Distance(p, 1), best, 1e-12);
  }
}

TEST(SurfaceTree, EmptyIsFarFromEverything) {
  const SurfaceTree tree(std::vector<Eigen::Vector3d>{});
  EXPECT_TRUE(tree.empty());
  EXPECT_EQ(tree.Distance({0, 0, 0}, 3), 3);
}

TEST(ThinnedCloud, KeepsOnePointPerCell) {
  ThinnedCloud cloud(0.5);
  const std::vector<Eigen::Vector3d> points = {
      {0.1, 0.1, 0.1}, {0.4, 0.4, 0.4}, {0.6, 0.1, 0.1}, {-0.1, 0.1, 0.1}};
  cloud.Add(points);
  cloud.Add(points);
  ASSERT_EQ(cloud.points().size(), 3u);
  EXPECT_EQ(cloud.points()[0], points[0]);
}

}  // namespace
}  // namespace raylift
