#include <cmath>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "raylift/evaluation/pose_errors.h"

namespace raylift {
namespace {

// The first `good` of `count` queries are localized well.
Comparison WithHits(int good, int count) {
  Comparison comparison;
  for (int i = 0; i < count; ++i) {
    comparison.queries.push_back({"q" + std::to_string(i), PoseError{i < good ? 0.01 : 10.0, 0.1}});
  }
  return comparison;
}

constexpr Threshold kThreshold{0.25, 2};

TEST(QueryBootstrap, IntervalsHaveTheBinomialsWidth) {
  const QueryBootstrap bootstrap(100, 1, 5000);
  const Interval interval = bootstrap.RecallPercent(WithHits(80, 100), kThreshold);
  // 80 +- 1.96 * sqrt(0.8 * 0.2 / 100) * 100 = 80 +- 7.8, in steps of 1
  EXPECT_NEAR(interval.low, 72.2, 1.5);
  EXPECT_NEAR(interval.high, 87.8, 1.5);
}

TEST(QueryBootstrap, PairedDifferencesKnowThatQueriesAreTheSame) {
  const QueryBootstrap bootstrap(100, 1);
  // Both fail at the same queries: there is no difference, however uncertain the recalls are.
  const Interval none =
      bootstrap.RecallDifferencePercent(WithHits(80, 100), WithHits(80, 100), kThreshold);
  EXPECT_EQ(none.low, 0);
  EXPECT_EQ(none.high, 0);
  const Interval noise =
      bootstrap.RecallDifferencePercent(WithHits(81, 100), WithHits(80, 100), kThreshold);
  EXPECT_TRUE(noise.Contains(0));
  const Interval real =
      bootstrap.RecallDifferencePercent(WithHits(90, 100), WithHits(80, 100), kThreshold);
  EXPECT_FALSE(real.Contains(0));
  EXPECT_TRUE(real.Contains(10));
}

TEST(QueryBootstrap, MediansCountFailuresAsInfinite) {
  Comparison comparison = WithHits(3, 10);
  for (size_t i = 3; i < 10; ++i) comparison.queries[i].error.reset();
  const QueryBootstrap bootstrap(10, 1);
  EXPECT_EQ(bootstrap.MedianPosition(comparison).high, std::numeric_limits<double>::infinity());
  const Interval all_good = bootstrap.MedianPosition(WithHits(10, 10));
  EXPECT_EQ(all_good.low, 0.01);
  EXPECT_EQ(all_good.high, 0.01);
}

}  // namespace
}  // namespace raylift
