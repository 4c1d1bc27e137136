// The kernels that the scorer calls have tests of their own (kernels_test.cc).

#include "estimation/joint_score.h"

#include <gtest/gtest.h>

namespace raylift {
namespace {

constexpr int kNumPoints = 40;
constexpr int kNumPairs = 100;
constexpr ScoreCombination kEveryCombination[] = {
    ScoreCombination::kSumInliers, ScoreCombination::kSumInlierRatios,
    ScoreCombination::kMultInliers, ScoreCombination::kSumMsac, ScoreCombination::kMultMsac};
constexpr Objective::Sets kEverySets[] = {Objective::Sets::kPoints, Objective::Sets::kPairs,
                                          Objective::Sets::kBoth};

JointScore Score(double point_cost, int point_inliers, double pair_cost, int pair_inliers) {
  return {{point_cost, point_inliers}, {pair_cost, pair_inliers}};
}

TEST(Objective, CombinesBothSetsAsThePapersSay) {
  const JointScore score = Score(12.5, 30, 20.25, 85);
  const auto value = [&](ScoreCombination combination) {
    return Objective(Objective::Sets::kBoth, combination, kNumPoints, kNumPairs).Value(score);
  };
  EXPECT_EQ(value(ScoreCombination::kSumInliers), -(30 + 85));
  EXPECT_EQ(value(ScoreCombination::kSumInlierRatios), -(30. / 40 + 85. / 100));
  EXPECT_EQ(value(ScoreCombination::kMultInliers), -30 * 85);
  EXPECT_EQ(value(ScoreCombination::kSumMsac), 12.5 + 20.25);
  EXPECT_EQ(value(ScoreCombination::kMultMsac), 13.5 * 21.25) << "one match more in each factor";
  EXPECT_EQ(Objective(Objective::Sets::kBoth, ScoreCombination::kMultMsac, kNumPoints, kNumPairs,
                      Refinement::kPaper)
                .Value(score),
            12.5 * 20.25);
}

TEST(Objective, OfOneSetIsItsMsacCostWhateverTheCombination) {
  const JointScore score = Score(12.5, 30, 20.25, 85);
  for (const ScoreCombination combination : kEveryCombination) {
    const Objective points(Objective::Sets::kPoints, combination, kNumPoints, kNumPairs);
    EXPECT_EQ(points.Value(score), 12.5);
    EXPECT_TRUE(points.UsesPoints() && !points.UsesPairs());
    const Objective pairs(Objective::Sets::kPairs, combination, kNumPoints, kNumPairs);
    EXPECT_EQ(pairs.Value(score), 20.25);
    EXPECT_TRUE(pairs.UsesPairs() && !pairs.UsesPoints());
  }
}

TEST(Objective, OfBothIsThatOfTheOtherSetWhereOneIsEmpty) {
  const JointScore score = Score(12.5, 30, 20.25, 85);
  for (const ScoreCombination combination : kEveryCombination) {
    const Objective no_points(Objective::Sets::kBoth, combination, 0, kNumPairs);
    EXPECT_EQ(no_points.Value(score), 20.25);
    EXPECT_FALSE(no_points.UsesPoints());
    const Objective no_pairs(Objective::Sets::kBoth, combination, kNumPoints, 0);
    EXPECT_EQ(no_pairs.Value(score), 12.5);
    EXPECT_FALSE(no_pairs.UsesPairs());
  }
}

// What lets the scorer stop as soon as the best that is still possible is not good enough.
TEST(Objective, GrowsWithEitherCostAndFallsWithEitherInlierCount) {
  for (const Objective::Sets sets : kEverySets) {
    for (const ScoreCombination combination : kEveryCombination) {
      const Objective objective(sets, combination, kNumPoints, kNumPairs);
      for (const double cost : {0.0, 7.5, 30.0}) {
        for (const int inliers : {0, 10, 39}) {
          const double value = objective.Value(Score(cost, inliers, 2 * cost, 2 * inliers));
          EXPECT_LE(value, objective.Value(Score(cost + 1, inliers, 2 * cost, 2 * inliers)));
          EXPECT_LE(value, objective.Value(Score(cost, inliers, 2 * cost + 1, 2 * inliers)));
          EXPECT_GE(value, objective.Value(Score(cost, inliers + 1, 2 * cost, 2 * inliers)));
          EXPECT_GE(value, objective.Value(Score(cost, inliers, 2 * cost, 2 * inliers + 1)));
        }
      }
    }
  }
}

}  // namespace
}  // namespace raylift
