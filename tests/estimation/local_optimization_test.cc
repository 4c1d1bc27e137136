#include "estimation/local_optimization.h"

#include <algorithm>

#include "estimation/joint_score.h"
#include "estimation/near_truth.h"

namespace raylift {
namespace {

constexpr ResidualKinds kPoints{.points = true, .pairs = false};
constexpr ResidualKinds kPairs{.points = false, .pairs = true};
constexpr ResidualKinds kBoth{.points = true, .pairs = true};

// So few matches that all take part.
SyntheticOptions FewMatches() {
  SyntheticOptions options;
  options.num_2d3d = 300;
  options.num_2d2d = 300;
  options.num_references = 4;
  options.outlier_ratio_2d3d = options.outlier_ratio_2d2d = {0.3, 0.3};
  return options;
}

double Cost(const PreparedProblem& problem, const SolverPose& pose, ResidualKinds kinds) {
  const Objective any(Objective::Sets::kBoth, ScoreCombination::kSumMsac, 1, 1);
  const JointScore score = Scorer(problem, any).ScoreAll(pose);
  return (kinds.points ? score.points.cost : 0) + (kinds.pairs ? score.pairs.cost : 0);
}

TEST(OptimizeLocally, MoreStepsNeverCostMore) {
  Rng rng = TestRng();
  for (const ResidualKinds kinds : {kPoints, kPairs, kBoth}) {
    for (int trial = 0; trial < 10; ++trial) {
      const NearTruth near = MakeNearTruth(rng, FewMatches(), 1, 0.1);
      double least = 1e9;
      for (int steps = 0; steps <= 8; ++steps) {
        const double cost =
            Cost(near.prepared, OptimizeLocally(near.prepared, near.local, kinds, steps), kinds);
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
    const NearTruth near = MakeNearTruth(rng, FewMatches(), 0.8, 0.02);
    const Objective any(Objective::Sets::kBoth, ScoreCombination::kSumMsac, 1, 1);
    const Scorer scorer(near.prepared, any);
    const int at_truth = scorer.CountInliers(near.local_truth).points;
    EXPECT_LT(scorer.CountInliers(near.local).points, 0.5 * at_truth);
    for (const ResidualKinds kinds : {kPoints, kBoth}) {
      const SolverPose pose = OptimizeLocally(near.prepared, near.local, kinds, 6);
      EXPECT_GT(scorer.CountInliers(pose).points, 0.97 * at_truth);
      EXPECT_TRUE(near.IsTrue(pose, 0.1, 0.03));
    }
  }
}

TEST(OptimizeLocally, OfOneKindTakesNoNoticeOfTheOther) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, FewMatches(), 0.5, 0.05);
  PreparedProblem points_alone = near.prepared;
  points_alone.pair_blocks.clear();
  points_alone.pair_block_view.clear();
  PreparedProblem pairs_alone = near.prepared;
  pairs_alone.point_blocks.clear();
  const auto expect_equal = [](const SolverPose& a, const SolverPose& b) {
    EXPECT_EQ(a.rotation, b.rotation);
    EXPECT_EQ(a.translation, b.translation);
  };
  expect_equal(OptimizeLocally(near.prepared, near.local, kPoints, 6),
               OptimizeLocally(points_alone, near.local, kPoints, 6));
  expect_equal(OptimizeLocally(points_alone, near.local, kPoints, 6),
               OptimizeLocally(points_alone, near.local, kBoth, 6));
  expect_equal(OptimizeLocally(near.prepared, near.local, kPairs, 6),
               OptimizeLocally(pairs_alone, near.local, kPairs, 6));
}

}  // namespace
}  // namespace raylift
