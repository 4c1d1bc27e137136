#include "estimation/final_refinement.h"

#include "estimation/local_optimization.h"
#include "estimation/near_truth.h"

namespace raylift {
namespace {

constexpr ResidualKinds kPoints{.points = true, .pairs = false};
constexpr ResidualKinds kPairs{.points = false, .pairs = true};
constexpr ResidualKinds kBoth{.points = true, .pairs = true};

SyntheticOptions NoiseFree(double outlier_ratio) {
  SyntheticOptions options;
  options.sigma_px = 0;
  options.outlier_ratio_2d3d = options.outlier_ratio_2d2d = {outlier_ratio, outlier_ratio};
  return options;
}

FinalPose Refine(const NearTruth& near, const SolverPose& start, ResidualKinds kinds,
                 Refinement refinement = Refinement::kRobust) {
  return RefineFinally(near.prepared, GatherEvidence(near.synthetic.problem, near.prepared), start,
                       kinds, {.refinement = refinement});
}

TEST(RefineFinally, ReachesTheTruthOfNoiseFreeMatches) {
  Rng rng = TestRng();
  for (const ResidualKinds kinds : {kPoints, kPairs, kBoth}) {
    for (int trial = 0; trial < 10; ++trial) {
      const NearTruth clean = MakeNearTruth(rng, NoiseFree(0), 0.3, 0.03);
      EXPECT_TRUE(clean.IsTrue(Refine(clean, clean.local, kinds).pose, 1e-5, 1e-6));
      // A few outliers lie near an epipolar line by chance. Some noise is always assumed, so that
      // they pull a little.
      const NearTruth dirty = MakeNearTruth(rng, NoiseFree(0.3), 0.3, 0.03);
      EXPECT_TRUE(dirty.IsTrue(Refine(dirty, dirty.local, kinds).pose, 1e-3, 2e-4));
    }
  }
}

TEST(RefineFinally, DoesNotDependOnWhereItStartsWithinTheThreshold) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {}, 0.1, 0.01);
  for (const ResidualKinds kinds : {kPoints, kPairs, kBoth}) {
    const FinalPose from_near = Refine(near, near.local, kinds);
    const FinalPose from_truth = Refine(near, near.local_truth, kinds);
    // Within a third of the standard deviation, some 3 mm.
    EXPECT_TRUE(IsNearPose(near.prepared.CamFromWorld(from_near.pose),
                           near.prepared.CamFromWorld(from_truth.pose), 1e-2, 1e-3));
  }
}

TEST(RefineFinally, LeavesThePosesOfThePaperAsTheyAre) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  for (const ResidualKinds kinds : {kPoints, kPairs, kBoth}) {
    const FinalPose same = Refine(near, near.local, kinds, Refinement::kPaper);
    EXPECT_EQ(same.pose.rotation, near.local.rotation);
    EXPECT_EQ(same.pose.translation, near.local.translation);
    EXPECT_TRUE(same.covariance);
  }
}

TEST(RefineFinally, HasACovarianceUnlessThePoseIsUndetermined) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  for (const ResidualKinds kinds : {kPoints, kPairs, kBoth}) {
    const auto covariance = Refine(near, near.local, kinds).covariance;
    ASSERT_TRUE(covariance);
    EXPECT_EQ(*covariance, covariance->transpose());
    EXPECT_TRUE((covariance->diagonal().array() > 0).all());
  }
  SyntheticOptions nothing;
  nothing.num_2d3d = 2;
  nothing.num_2d2d = 0;
  nothing.outlier_ratio_2d3d = {0, 0};
  const NearTruth two_points = MakeNearTruth(rng, nothing, 0, 0);
  EXPECT_FALSE(Refine(two_points, two_points.local, kPoints).covariance);
  EXPECT_FALSE(Refine(two_points, two_points.local, kBoth).covariance);
}

}  // namespace
}  // namespace raylift
