#include "comparison/surface_distance.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "base/rng.h"
#include "support/matchers.h"
#include "support/meshes.h"

#include "raylift/lifting/mesh_source.h"

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
  ThinnedCloud cloud(0.5, 100);
  const std::vector<Eigen::Vector3d> points = {
      {0.1, 0.1, 0.1}, {0.4, 0.4, 0.4}, {0.6, 0.1, 0.1}, {-0.1, 0.1, 0.1}};
  cloud.Add(points);
  cloud.Add(points);
  ASSERT_EQ(cloud.points().size(), 3u);
  EXPECT_EQ(cloud.points()[0], points[0]);
}

TEST(ThinnedCloud, StaysBelowItsLimitAndIsAFairSample) {
  Rng rng = TestRng();
  ThinnedCloud cloud(0.001, 10000);
  for (int batch = 0; batch < 20; ++batch) {
    std::vector<Eigen::Vector3d> points;
    // Three of four are on the left.
    for (int i = 0; i < 5000; ++i) {
      points.emplace_back(rng.Uniform() + (i % 4 == 0 ? 1 : 0), rng.Uniform(), 0);
    }
    cloud.Add(points);
    EXPECT_LE(cloud.points().size(), 10000u);
  }
  // Some 97000 cells, halved four times.
  EXPECT_GT(cloud.points().size(), 5000u);
  const auto left = std::count_if(cloud.points().begin(), cloud.points().end(),
                                  [](const Eigen::Vector3d& point) { return point.x() < 1; });
  // Of 75000 and 25000 that fall into 1e6 cells each, 72300 and 24700 are the first of theirs.
  // Three standard deviations of the share among 5700 are 0.017.
  EXPECT_NEAR(static_cast<double>(left) / static_cast<double>(cloud.points().size()), 0.745, 0.02);
}

// A wall at z = 2 of which the source shows the left half, some of it 5 cm too near.
TEST(SurfaceScorer, CountsWhatIsNearAndWhatIsCovered) {
  const double params[] = {100, 100, 100, 75};
  const PosedImage view{"view", Camera(CameraModel::kPinhole, 200, 150, params), Rigid3{}};
  const auto mesh = std::make_shared<const TriangleMesh>(
      MakePlane({Eigen::Quaterniond::Identity(), {0, 0, 2}}, 10, 1));
  const MeshSource truth("mesh:wall", std::make_shared<const RayCaster>(mesh));
  std::vector<Eigen::Vector3d> points;
  size_t off = 0, pixels = 0;
  for (const Eigen::Vector2d& pixel : ScoredPixels(view.camera)) {
    ++pixels;
    if (pixel.x() > 100) continue;
    const bool is_off = pixel.y() < 75;
    off += is_off;
    points.push_back(2 * *view.camera.RayInCam(pixel) / view.camera.RayInCam(pixel)->z());
    if (is_off) points.back().z() = 1.95;
  }
  ASSERT_GT(pixels, 1500u);
  SurfaceScorer scorer(*mesh, truth, std::span(&view, 1), 2, std::vector<double>{0.02, 0.06}, 2);
  const std::vector<std::vector<Eigen::Vector3d>> shown = {{}, points};
  scorer.Add(shown, 0);
  scorer.Add(shown, 0);  // the same view once more changes nothing
  EXPECT_TRUE(scorer.Score(0).empty());
  const auto scores = scorer.Score(1);
  ASSERT_EQ(scores.size(), 2u);
  EXPECT_NEAR(scores[0].accuracy_percent,
              100 - 100.0 * static_cast<double>(off) / static_cast<double>(points.size()), 1e-9);
  EXPECT_EQ(scores[1].accuracy_percent, 100);
  // A quarter; half, and a column of pixels that is within 6 cm of it (8 cm wide, like all).
  EXPECT_NEAR(scores[0].completeness_percent, 25, 2);
  EXPECT_NEAR(scores[1].completeness_percent, 50, 3);
}

}  // namespace
}  // namespace raylift
