#include "estimation/refinement/refinement.h"

#include "estimation/near_truth.h"
#include "estimation/ransac/local_optimization.h"

namespace raylift {
namespace {

SyntheticOptions NoiseFree(double outlier_ratio) {
  SyntheticOptions options;
  options.sigma_px = 0;
  options.outlier_ratio_2d3d = options.outlier_ratio_2d2d = {outlier_ratio, outlier_ratio};
  return options;
}

RefinedPose Refine(const NearTruth& near, const CamFromLocal& start, MatchSets sets,
                   Refinement refinement = Refinement::kRobust) {
  return RefineFinally(near.prepared, GatherEvidence(near.synthetic.problem, near.prepared), start,
                       sets, {.refinement = refinement});
}

TEST(RefineFinally, ReachesTheTruthOfNoiseFreeMatches) {
  Rng rng = TestRng();
  for (const MatchSets sets : {MatchSets::k2D3D, MatchSets::k2D2D, MatchSets::kBoth}) {
    for (int trial = 0; trial < 10; ++trial) {
      const NearTruth clean = MakeNearTruth(rng, NoiseFree(0), 0.3, 0.03);
      EXPECT_TRUE(clean.IsTrue(Refine(clean, clean.local, sets).pose, 1e-5, 1e-6));
      // A few outliers lie near an epipolar line by chance. Some noise is always assumed, so that
      // they pull a little.
      const NearTruth dirty = MakeNearTruth(rng, NoiseFree(0.3), 0.3, 0.03);
      EXPECT_TRUE(dirty.IsTrue(Refine(dirty, dirty.local, sets).pose, 1e-3, 2e-4));
    }
  }
}

TEST(RefineFinally, DoesNotDependOnWhereItStartsWithinTheThreshold) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {}, 0.1, 0.01);
  for (const MatchSets sets : {MatchSets::k2D3D, MatchSets::k2D2D, MatchSets::kBoth}) {
    const RefinedPose from_near = Refine(near, near.local, sets);
    const RefinedPose from_truth = Refine(near, near.local_truth, sets);
    // Within a third of the standard deviation, some 3 mm.
    EXPECT_TRUE(IsNearPose(near.prepared.ToWorld(from_near.pose),
                           near.prepared.ToWorld(from_truth.pose), 1e-2, 1e-3));
  }
}

TEST(RefineFinally, LeavesThePosesOfThePaperAsTheyAre) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  for (const MatchSets sets : {MatchSets::k2D3D, MatchSets::k2D2D, MatchSets::kBoth}) {
    const RefinedPose same = Refine(near, near.local, sets, Refinement::kPaper);
    EXPECT_EQ(same.pose.rotation, near.local.rotation);
    EXPECT_EQ(same.pose.translation, near.local.translation);
    EXPECT_TRUE(same.covariance);
  }
}

TEST(RefineFinally, HasACovarianceUnlessThePoseIsUndetermined) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  for (const MatchSets sets : {MatchSets::k2D3D, MatchSets::k2D2D, MatchSets::kBoth}) {
    const auto covariance = Refine(near, near.local, sets).covariance;
    ASSERT_TRUE(covariance);
    EXPECT_EQ(*covariance, covariance->transpose());
    EXPECT_TRUE((covariance->diagonal().array() > 0).all());
  }
  SyntheticOptions nothing;
  nothing.num_2d3d = 2;
  nothing.num_2d2d = 0;
  nothing.outlier_ratio_2d3d = {0, 0};
  const NearTruth two_points = MakeNearTruth(rng, nothing, 0, 0);
  EXPECT_FALSE(Refine(two_points, two_points.local, MatchSets::k2D3D).covariance);
  EXPECT_FALSE(Refine(two_points, two_points.local, MatchSets::kBoth).covariance);
}

}  // namespace
}  // namespace raylift
