#include "estimation/final_refinement.h"

#include <numeric>

#include "estimation/near_truth.h"
#include "estimation/pose_minimizer.h"

namespace raylift {
namespace {

constexpr ResidualKinds kPoints{.points = true, .pairs = false};
constexpr ResidualKinds kPairs{.points = false, .pairs = true};
constexpr ResidualKinds kBoth{.points = true, .pairs = true};

constexpr double kShift = 0.05;  // of points, metres: about three pixels

SyntheticOptions NoiseFree(double outlier_ratio) {
  SyntheticOptions options;
  options.sigma_px = 0;
  options.outlier_ratio_2d3d = options.outlier_ratio_2d2d = {outlier_ratio, outlier_ratio};
  return options;
}

// The geometry is off as a whole, which its own residuals do not show; the pose is where it wants it.
NearTruth MakeWithShiftedPoints(Rng& rng, const Eigen::Vector3d& shift) {
  SyntheticProblem made = MakeSyntheticProblem("shifted", {}, rng);
  for (Match2D3D& match : made.problem.matches_2d3d) match.point_in_world += shift;
  Rigid3 shifted = made.query_from_world;
  shifted.translation -= shifted.rotation * shift;
  return NearTruth(std::move(made), shifted, rng);
}

// Where the pairs' truncated residuals are least.
SolverPose BestOfPairs(const NearTruth& near) {
  std::vector<int> all(near.prepared.pairs.size());
  std::iota(all.begin(), all.end(), 0);
  const auto pairs = MakePairBlocks<double>(near.prepared.pairs, all);
  const ActiveMatches<double> active{{}, pairs.blocks, pairs.block_reference};
  return Minimize(near.prepared, active, near.local_truth, KindWeights{}, 100, 0);
}

TEST(RefineFinally, ReachesTheTruthOfNoiseFreeMatches) {
  Rng rng = TestRng();
  for (const ResidualKinds kinds : {kPoints, kPairs, kBoth}) {
    for (int trial = 0; trial < 10; ++trial) {
      const NearTruth clean = MakeNearTruth(rng, NoiseFree(0), 0.3, 0.03);
      EXPECT_TRUE(clean.IsTrue(RefineFinally(clean.prepared, clean.local, kinds).pose, 1e-8, 1e-9));
      // A few outliers lie near an epipolar line by chance. Some noise is always assumed, so that
      // they pull a little.
      const NearTruth dirty = MakeNearTruth(rng, NoiseFree(0.3), 0.3, 0.03);
      EXPECT_TRUE(dirty.IsTrue(RefineFinally(dirty.prepared, dirty.local, kinds).pose, 1e-3, 2e-4));
    }
  }
}

TEST(RefineFinally, DoesNotDependOnWhereItStartsWithinTheThreshold) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {}, 0.1, 0.01);
  for (const ResidualKinds kinds : {kPoints, kPairs, kBoth}) {
    const SolverPose from_near = RefineFinally(near.prepared, near.local, kinds).pose;
    const SolverPose from_truth = RefineFinally(near.prepared, near.local_truth, kinds).pose;
    EXPECT_TRUE(IsNearPose(near.prepared.CamFromWorld(from_near),
                           near.prepared.CamFromWorld(from_truth), 1e-3, 1e-4));
  }
}

TEST(RefineFinally, AsksForASearchOnlyWherePointsAndPairsContradictEachOther) {
  Rng rng = TestRng();
  int searches = 0;
  const PoseSearch search = [&searches]() -> std::optional<SolverPose> {
    ++searches;
    return std::nullopt;
  };
  const NearTruth agreeing = MakeNearTruth(rng, {});
  RefineFinally(agreeing.prepared, agreeing.local, kBoth, search);
  EXPECT_EQ(searches, 0);
  const NearTruth contradicting = MakeWithShiftedPoints(rng, {kShift, 0, 0});
  RefineFinally(contradicting.prepared, contradicting.local, kPoints, search);
  RefineFinally(contradicting.prepared, contradicting.local, kPairs, search);
  EXPECT_EQ(searches, 0) << "one kind alone contradicts nothing";
  RefineFinally(contradicting.prepared, contradicting.local, kBoth, search);
  EXPECT_EQ(searches, 1);
}

TEST(RefineFinally, BelievesThePairsWhereThePointsContradictThem) {
  Rng rng = TestRng();
  for (int trial = 0; trial < 10; ++trial) {
    const NearTruth near = MakeWithShiftedPoints(rng, {0, kShift, 0});
    const auto error = [&near](ResidualKinds kinds) {
      const SolverPose pose = RefineFinally(near.prepared, near.local, kinds).pose;
      return (near.prepared.CamFromWorld(pose).OriginInSource() -
              near.synthetic.query_from_world.OriginInSource())
          .norm();
    };
    EXPECT_NEAR(error(kPoints), kShift, 0.3 * kShift);
    EXPECT_LT(error(kBoth), error(kPairs) + 0.1 * kShift);
  }
}

TEST(RefineFinally, StartsAnewFromTheSearchedPoseWhereThatFitsThePairsBest) {
  Rng rng = TestRng();
  const NearTruth near = MakeWithShiftedPoints(rng, {kShift, 0, 0});
  const SolverPose& start = near.local;
  const SolverPose other_start = RefineFinally(near.prepared, start, kPoints).pose;
  const auto refine = [&near](const SolverPose& from, const PoseSearch& search) {
    return RefineFinally(near.prepared, from, kBoth, search).pose.translation;
  };
  const PoseSearch best = [&near] { return std::optional(BestOfPairs(near)); };
  EXPECT_NE(refine(start, {}), refine(other_start, {}));
  EXPECT_EQ(refine(start, best), refine(other_start, best));
  const PoseSearch worse = [&start] { return std::optional(start); };
  EXPECT_EQ(refine(start, worse), refine(start, {}));
}

TEST(RefineFinally, HasACovarianceUnlessThePoseIsUndetermined) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  const auto covariance = RefineFinally(near.prepared, near.local, kBoth).covariance;
  ASSERT_TRUE(covariance);
  EXPECT_EQ(*covariance, covariance->transpose());
  EXPECT_TRUE((covariance->diagonal().array() > 0).all());

  SyntheticOptions nothing;
  nothing.num_2d3d = 2;
  nothing.num_2d2d = 0;
  nothing.outlier_ratio_2d3d = {0, 0};
  const NearTruth two_points = MakeNearTruth(rng, nothing, 0, 0);
  EXPECT_FALSE(RefineFinally(two_points.prepared, two_points.local, kBoth).covariance);
}

}  // namespace
}  // namespace raylift
