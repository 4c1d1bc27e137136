#include "base/rng.h"

#include <cmath>
#include <set>

#include <gtest/gtest.h>

namespace raylift {
namespace {

TEST(Rng, IsTheSameOnEveryMachine) {
  Rng rng(42);
  // Values of xoshiro256** with state from splitmix64(42), as other implementations give them.
  EXPECT_EQ(rng.NextBits(), 1546998764402558742ull);
  EXPECT_EQ(rng.NextBits(), 6990951692964543102ull);
}

TEST(Rng, UniformIndexCoversItsRange) {
  Rng rng(1);
  std::vector<int> counts(7, 0);
  for (int i = 0; i < 70000; ++i) ++counts[rng.UniformIndex(7)];
  // 10000 expected each with standard deviation 93: six of them.
  for (const int count : counts) EXPECT_NEAR(count, 10000, 560);
}

TEST(Rng, NormalHasZeroMeanAndUnitVariance) {
  Rng rng(2);
  double sum = 0;
  double sum_squares = 0;
  const int n = 100000;
  for (int i = 0; i < n; ++i) {
    const double x = rng.Normal();
    sum += x;
    sum_squares += x * x;
  }
  EXPECT_NEAR(sum / n, 0, 6 / std::sqrt(n));
  EXPECT_NEAR(sum_squares / n, 1, 6 * std::sqrt(2.0 / n));
}

TEST(StreamSeed, DiffersByEachOfItsParts) {
  const std::set<uint64_t> seeds = {StreamSeed(0, "a", "b"), StreamSeed(1, "a", "b"),
                                    StreamSeed(0, "ab", ""), StreamSeed(0, "", "ab"),
                                    StreamSeed(0, "b", "a")};
  EXPECT_EQ(seeds.size(), 5u);
}

}  // namespace
}  // namespace raylift
