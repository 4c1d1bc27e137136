#include <algorithm>
#include <cmath>
#include <vector>

#include "base/rng.h"
#include "localization/alignment/edge_score.h"
#include "support/matchers.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

double Exponential(Rng& rng) { return -std::log(1 - rng.Uniform()); }

std::vector<double> Sorted(std::vector<double> scores) {
  std::sort(scores.rbegin(), scores.rend());
  return scores;
}

// The share of searches by chance, from `times` as many positions, whose best is called rarer than
// `p` by what `count` modes of another one tell.
double ShareBelow(double p, size_t count, size_t times) {
  constexpr int kTrials = 20000;
  Rng rng = TestRng();
  int below = 0;
  for (int i = 0; i < kTrials; ++i) {
    std::vector<double> by_chance(count);
    for (double& score : by_chance) score = 7 + 3 * Exponential(rng);
    double best = 0;
    for (size_t k = 0; k < times * count; ++k) best = std::max(best, 7 + 3 * Exponential(rng));
    const double told = ChanceOfScore(best, Sorted(by_chance), static_cast<double>(times));
    below += told < p ? 1 : 0;
  }
  return static_cast<double>(below) / kTrials;
}

TEST(ChanceOfScore, IsAsRareAsItSaysWhereScoresAreExponential) {
  for (const size_t count : {5, 20, 40}) {
    for (const size_t times : {1, 6}) {
      // 20,000 trials know 5 % to .15 % and 1 % to .07 %.
      EXPECT_LT(ShareBelow(0.05, count, times), 0.055) << count << " " << times;
      EXPECT_LT(ShareBelow(0.01, count, times), 0.0125) << count << " " << times;
      EXPECT_GT(ShareBelow(0.05, count, times), 0.02) << count << " " << times;
    }
  }
}

TEST(ChanceOfScore, SaysNoMoreThanItsScoresDo) {
  const std::vector<double> scores = {500, 60, 59, 58, 57, 56, 55, 54, 53, 52, 51};
  EXPECT_EQ(ChanceOfScore(50, scores, 1), 1);
  // One of them is as good.
  EXPECT_GT(ChanceOfScore(480, scores, 1), 0.6);
  EXPECT_GT(ChanceOfScore(480, scores, 10), 0.99);
  EXPECT_EQ(ChanceOfScore(1e9, std::vector<double>{2, 1}, 1), 1);
  EXPECT_EQ(ChanceOfScore(1e9, std::vector<double>{1, 1, 1, 1}, 1), 1);
}

TEST(LeastProbabilityOfChance, IsSellkesBound) {
  EXPECT_EQ(LeastProbabilityOfChance(0), 0);
  EXPECT_EQ(LeastProbabilityOfChance(0.5), 1);
  // Their table: p of .05 and .01 are odds of .407 and .125.
  EXPECT_NEAR(LeastProbabilityOfChance(0.05), 0.289, 0.001);
  EXPECT_NEAR(LeastProbabilityOfChance(0.01), 0.111, 0.001);
}

TEST(LeastScore, IsTwoDeviationsBelowTheSum) {
  CellScores cells = CellScores::Zero();
  cells.head<4>().setConstant(5);
  EXPECT_DOUBLE_EQ(LeastScore(cells), 20 - 2 * 10);
}

}  // namespace
}  // namespace raylift
