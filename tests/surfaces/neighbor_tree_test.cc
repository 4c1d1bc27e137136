#include "surfaces/neighbor_tree.h"

#include <algorithm>
#include <chrono>
#include <vector>

#include "support/matchers.h"
#include <gtest/gtest.h>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

using Neighbor = NeighborTree::Neighbor;

// A dense clump in a sparse cube, some points twice.
std::vector<Eigen::Vector3f> UnevenPoints() {
  Rng rng = TestRng();
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 1500; ++i) {
    const double size = i % 3 == 0 ? 10 : 0.1;
    points.emplace_back(
        Eigen::Vector3d(rng.Uniform(0, size), rng.Uniform(0, size), rng.Uniform(0, size))
            .cast<float>());
    if (i % 10 == 0) points.push_back(points.back());
  }
  return points;
}

TEST(NeighborTree, FindsWhatAllDistancesSay) {
  const std::vector<Eigen::Vector3f> points = UnevenPoints();
  const NeighborTree tree(points);
  std::vector<Neighbor> room(9);
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(tree.point(i), points[tree.IndexOf(i)]);
    const auto squared_to = [&](const Eigen::Vector3f& point) {
      return (point.cast<double>() - tree.point(i).cast<double>()).squaredNorm();
    };
    std::vector<double> expected;
    for (size_t j = 0; j < points.size(); ++j) {
      const double squared = squared_to(points[j]);
      const bool is_twin = j > 0 && points[j] == points[j - 1];
      if (squared > 0 && !is_twin) expected.push_back(squared);
    }
    std::sort(expected.begin(), expected.end());
    const auto found = tree.Nearest(i, room);
    ASSERT_EQ(found.size(), room.size());
    for (size_t k = 0; k < found.size(); ++k) {
      EXPECT_DOUBLE_EQ(found[k].squared_distance, expected[k]);
      EXPECT_EQ(squared_to(tree.point(found[k].point)), expected[k]);
    }
  }
}

TEST(NeighborTree, PointsAtOnePlaceAreOne) {
  const std::vector<Eigen::Vector3f> points = {{0, 0, 0}, {0, 0, 0}, {1, 0, 0}};
  const NeighborTree tree(points);
  std::vector<Neighbor> room(5);
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(tree.Nearest(i, room).size(), 1u);
  }
}

TEST(NeighborTree, AWatchIsAskedWhileItIsMade) {
  Rng rng = TestRng();
  std::vector<Eigen::Vector3f> points(500000);
  for (Eigen::Vector3f& point : points) {
    for (float& coordinate : point) coordinate = static_cast<float>(rng.Uniform(0, 1));
  }
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  OrderInSpace(points, 21);
  const auto of_order = Clock::now() - start;  // which is a fourth of the whole, or less
  bool is_ended = false;
  for (int attempt = 0; attempt < 20 && !is_ended; ++attempt) {
    const auto begin = Clock::now();
    const CallWatch watch({.stop_wanted = [&] { return Clock::now() - begin > 1.5 * of_order; }});
    try {
      NeighborTree{points};
    } catch (const Cancelled&) {
      is_ended = true;
    }
  }
  EXPECT_TRUE(is_ended);
}

}  // namespace
}  // namespace raylift
