#include "estimation/ransac/local_optimization.h"

#include <algorithm>

#include "estimation/near_truth.h"
#include "estimation/ransac/scores.h"

namespace raylift {
namespace {

// So few matches that all take part.
SyntheticOptions MatchesToOptimize() {
  SyntheticOptions options;
  options.num_2d3d = 300;
  options.num_2d2d = 300;
  options.num_references = 4;
  options.outlier_ratio_2d3d = options.outlier_ratio_2d2d = {0.3, 0.3};
  return options;
}

double Cost(const NormalizedProblem& problem, const CamFromLocal& pose, MatchSets sets) {
  const PoseScore any(MatchSets::kBoth, ScoreCombination::kSumMsac, 1, 1);
  const SetScores score = Scorer(problem, any).ScoreAll(pose);
  return (Has2D3D(sets) ? score.of_2d3d.cost : 0) + (Has2D2D(sets) ? score.of_2d2d.cost : 0);
}

TEST(OptimizeLocally, MoreStepsNeverCostMore) {
  Rng rng = TestRng();
  for (const MatchSets sets : {MatchSets::k2D3D, MatchSets::k2D2D, MatchSets::kBoth}) {
    for (int trial = 0; trial < 10; ++trial) {
      const NearTruth near = MakeNearTruth(rng, MatchesToOptimize(), 1, 0.1);
      double least = 1e9;
      for (int steps = 0; steps <= 8; ++steps) {
        const double cost =
            Cost(near.prepared, OptimizeLocally(near.prepared, near.local, sets, steps), sets);
        EXPECT_LE(cost, (1 + 1e-5) * least);  // sums in single precision
        least = std::min(least, cost);
      }
    }
  }
}

// From a pose under which most inliers lie one to three thresholds off.
TEST(OptimizeLocally, ReachesTheInliersThatLieNear) {
  Rng rng = TestRng();
  for (int trial = 0; trial < 10; ++trial) {
    const NearTruth near = MakeNearTruth(rng, MatchesToOptimize(), 0.8, 0.02);
    const PoseScore any(MatchSets::kBoth, ScoreCombination::kSumMsac, 1, 1);
    const Scorer scorer(near.prepared, any);
    const int at_truth = scorer.CountInliers(near.local_truth).of_2d3d;
    EXPECT_LT(scorer.CountInliers(near.local).of_2d3d, 0.5 * at_truth);
    for (const MatchSets sets : {MatchSets::k2D3D, MatchSets::kBoth}) {
      const CamFromLocal pose = OptimizeLocally(near.prepared, near.local, sets, 6);
      EXPECT_GT(scorer.CountInliers(pose).of_2d3d, 0.97 * at_truth);
      EXPECT_TRUE(near.IsTrue(pose, 0.1, 0.03));
    }
  }
}

TEST(OptimizeLocally, OfOneKindTakesNoNoticeOfTheOther) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, MatchesToOptimize(), 0.5, 0.05);
  NormalizedProblem points_alone = near.prepared;
  points_alone.blocks_2d2d.clear();
  points_alone.block_camera_reference_2d2d.clear();
  NormalizedProblem pairs_alone = near.prepared;
  pairs_alone.blocks_2d3d.clear();
  const auto expect_equal = [](const CamFromLocal& a, const CamFromLocal& b) {
    EXPECT_EQ(a.rotation, b.rotation);
    EXPECT_EQ(a.translation, b.translation);
  };
  expect_equal(OptimizeLocally(near.prepared, near.local, MatchSets::k2D3D, 6),
               OptimizeLocally(points_alone, near.local, MatchSets::k2D3D, 6));
  expect_equal(OptimizeLocally(points_alone, near.local, MatchSets::k2D3D, 6),
               OptimizeLocally(points_alone, near.local, MatchSets::kBoth, 6));
  expect_equal(OptimizeLocally(near.prepared, near.local, MatchSets::k2D2D, 6),
               OptimizeLocally(pairs_alone, near.local, MatchSets::k2D2D, 6));
}

}  // namespace
}  // namespace raylift
