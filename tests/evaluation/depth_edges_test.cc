#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "base/rng.h"
#include <gtest/gtest.h>

#include "raylift/evaluation/depth_errors.h"

namespace raylift {
namespace {

// A near half (left of `border`) and a far half.
DepthMap Step(int border, float near = 2, float far = 3) {
  DepthMap map{40, 20, {}};
  for (int y = 0; y < map.height_px; ++y) {
    for (int x = 0; x < map.width_px; ++x) map.z.push_back(x < border ? near : far);
  }
  return map;
}

TEST(DepthEdges, AreTheNearSidesOfJumps) {
  const DepthMap map = Step(15);
  const auto edges = FindDepthEdges(map);
  for (size_t i = 0; i < edges.size(); ++i) EXPECT_EQ(edges[i], i % 40 == 14) << i;
}

TEST(DepthEdges, SlopesAndHolesAreNone) {
  DepthMap map = Step(0);
  for (size_t i = 0; i < map.z.size(); ++i) map.z[i] = 2 + 0.04F * static_cast<float>(i % 40);
  map.z[100] = 0;
  for (const uint8_t edge : FindDepthEdges(map)) EXPECT_EQ(edge, 0);
}

TEST(DistanceToSet, IsExact) {
  constexpr int kWidth = 37, kHeight = 23;
  Rng rng(StreamSeed(0, "DistanceToSet.IsExact", ""));
  for (const double share : {0.002, 0.02, 0.3}) {
    std::vector<uint8_t> mask(size_t{kWidth} * kHeight, 0);
    for (uint8_t& set : mask) set = rng.Uniform() < share;
    const auto distances = DistanceToSet(mask, kWidth);
    for (int i = 0; i < kWidth * kHeight; ++i) {
      double best = std::numeric_limits<double>::infinity();
      for (int j = 0; j < kWidth * kHeight; ++j) {
        if (mask[static_cast<size_t>(j)] == 0) continue;
        best = std::min(best, std::hypot(i % kWidth - j % kWidth, i / kWidth - j / kWidth));
      }
      EXPECT_FLOAT_EQ(distances[static_cast<size_t>(i)], static_cast<float>(best));
    }
  }
}

TEST(DistanceToSet, IsInfiniteWhereNothingIsSet) {
  for (const float distance : DistanceToSet(std::vector<uint8_t>(12, 0), 4)) {
    EXPECT_EQ(distance, std::numeric_limits<float>::infinity());
  }
}

TEST(EdgeErrors, AMovedEdgeIsOffByItsShift) {
  const auto truth = FindDepthEdges(Step(15));
  const EdgeErrors moved = ComputeEdgeErrors(FindDepthEdges(Step(18)), truth, 40);
  EXPECT_NEAR(*moved.accuracy_px, 3, 1e-6);
  EXPECT_NEAR(*moved.completeness_px, 3, 1e-6);
  EXPECT_EQ(moved.spurious_percent, 0);
  const EdgeErrors far = ComputeEdgeErrors(FindDepthEdges(Step(35)), truth, 40);
  EXPECT_FALSE(far.accuracy_px.has_value());
  EXPECT_NEAR(*far.completeness_px, 10, 1e-6);
  EXPECT_EQ(far.spurious_percent, 100);
  const EdgeErrors none = ComputeEdgeErrors(FindDepthEdges(Step(0)), truth, 40);
  EXPECT_NEAR(*none.completeness_px, 10, 1e-6);
  EXPECT_FALSE(ComputeEdgeErrors(truth, FindDepthEdges(Step(0)), 40).completeness_px.has_value());
}

}  // namespace
}  // namespace raylift
