// The kernels that the scorer calls have tests of their own (kernels_test.cc).

#include "estimation/ransac/scores.h"

#include <gtest/gtest.h>

namespace raylift {
namespace {

constexpr int kNumPoints = 40;
constexpr int kNumPairs = 100;
constexpr ScoreCombination kEveryCombination[] = {
    ScoreCombination::kSumInliers, ScoreCombination::kSumInlierRatios,
    ScoreCombination::kMultInliers, ScoreCombination::kSumMsac, ScoreCombination::kMultMsac};
constexpr MatchSets kEverySets[] = {MatchSets::k2D3D, MatchSets::k2D2D, MatchSets::kBoth};

SetScores Score(double point_cost, int point_inliers, double pair_cost, int pair_inliers) {
  return {{point_cost, point_inliers}, {pair_cost, pair_inliers}};
}

TEST(PoseScore, CombinesBothSetsAsThePapersSay) {
  const SetScores score = Score(12.5, 30, 20.25, 85);
  const auto value = [&](ScoreCombination combination) {
    return PoseScore(MatchSets::kBoth, combination, kNumPoints, kNumPairs).Value(score);
  };
  EXPECT_EQ(value(ScoreCombination::kSumInliers), -(30 + 85));
  EXPECT_EQ(value(ScoreCombination::kSumInlierRatios), -(30. / 40 + 85. / 100));
  EXPECT_EQ(value(ScoreCombination::kMultInliers), -30 * 85);
  EXPECT_EQ(value(ScoreCombination::kSumMsac), 12.5 + 20.25);
  EXPECT_EQ(value(ScoreCombination::kMultMsac), 13.5 * 21.25) << "one match more in each factor";
  EXPECT_EQ(PoseScore(MatchSets::kBoth, ScoreCombination::kMultMsac, kNumPoints, kNumPairs,
                      Refinement::kPaper)
                .Value(score),
            12.5 * 20.25);
}

TEST(PoseScore, OfOneSetIsItsMsacCostWhateverTheCombination) {
  const SetScores score = Score(12.5, 30, 20.25, 85);
  for (const ScoreCombination combination : kEveryCombination) {
    const PoseScore points(MatchSets::k2D3D, combination, kNumPoints, kNumPairs);
    EXPECT_EQ(points.Value(score), 12.5);
    EXPECT_TRUE(Has2D3D(points.sets()) && !Has2D2D(points.sets()));
    const PoseScore pairs(MatchSets::k2D2D, combination, kNumPoints, kNumPairs);
    EXPECT_EQ(pairs.Value(score), 20.25);
    EXPECT_TRUE(Has2D2D(pairs.sets()) && !Has2D3D(pairs.sets()));
  }
}

TEST(PoseScore, OfBothIsThatOfTheOtherSetWhereOneIsEmpty) {
  const SetScores score = Score(12.5, 30, 20.25, 85);
  for (const ScoreCombination combination : kEveryCombination) {
    const PoseScore no_points(MatchSets::kBoth, combination, 0, kNumPairs);
    EXPECT_EQ(no_points.Value(score), 20.25);
    EXPECT_FALSE(Has2D3D(no_points.sets()));
    const PoseScore no_pairs(MatchSets::kBoth, combination, kNumPoints, 0);
    EXPECT_EQ(no_pairs.Value(score), 12.5);
    EXPECT_FALSE(Has2D2D(no_pairs.sets()));
  }
}

// What lets the scorer stop as soon as the best that is still possible is not good enough.
TEST(PoseScore, GrowsWithEitherCostAndFallsWithEitherInlierCount) {
  for (const MatchSets sets : kEverySets) {
    for (const ScoreCombination combination : kEveryCombination) {
      const PoseScore pose_score(sets, combination, kNumPoints, kNumPairs);
      for (const double cost : {0.0, 7.5, 30.0}) {
        for (const int inliers : {0, 10, 39}) {
          const double value = pose_score.Value(Score(cost, inliers, 2 * cost, 2 * inliers));
          EXPECT_LE(value, pose_score.Value(Score(cost + 1, inliers, 2 * cost, 2 * inliers)));
          EXPECT_LE(value, pose_score.Value(Score(cost, inliers, 2 * cost + 1, 2 * inliers)));
          EXPECT_GE(value, pose_score.Value(Score(cost, inliers + 1, 2 * cost, 2 * inliers)));
          EXPECT_GE(value, pose_score.Value(Score(cost, inliers, 2 * cost, 2 * inliers + 1)));
        }
      }
    }
  }
}

}  // namespace
}  // namespace raylift
