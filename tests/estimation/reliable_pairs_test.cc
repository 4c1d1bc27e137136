#include "estimation/reliable_pairs.h"

#include "estimation/match_residuals.h"
#include "support/matchers.h"
#include "support/synthetic_problem.h"

namespace raylift {
namespace {

constexpr double kLimit = 9;        // squared thresholds
constexpr double kVariance = 0.25;  // 1 px for a threshold of 2 px

struct Kept {
  int inliers = 0;
  int outliers = 0;
  int all_inliers = 0;  // with a residual below the limit
  int all_outliers = 0;
};

// At the true poses of some problems.
Kept CountKept(const SyntheticOptions& options, Rng& rng) {
  Kept kept;
  for (int trial = 0; trial < 10; ++trial) {
    const SyntheticProblem made = MakeSyntheticProblem("reliable", options, rng);
    const PreparedProblem prepared(made.problem, 4, 2, rng);
    const SolverPose truth = prepared.CamFromLocal(made.query_from_world);
    const std::vector<double> squared = ComputeResiduals(prepared, truth).pairs;
    const auto is_outlier = [&](int pair) {
      return static_cast<bool>(made.is_outlier_2d2d[prepared.pairs[pair].match]);
    };
    for (int i = 0; i < static_cast<int>(squared.size()); ++i) {
      if (squared[i] < kLimit) ++(is_outlier(i) ? kept.all_outliers : kept.all_inliers);
    }
    for (const int i : ReliablePairs(prepared, truth, squared, kVariance, kLimit)) {
      ++(is_outlier(i) ? kept.outliers : kept.inliers);
    }
  }
  return kept;
}

TEST(ReliablePairs, KeepsInliersAndDropsWhatIsNearByChance) {
  Rng rng = TestRng();
  const Kept kept = CountKept(RegimeByName("many_outliers").options, rng);
  EXPECT_GE(kept.inliers, 0.97 * kept.all_inliers);
  // The others lie among the true points and pull no harder than these.
  EXPECT_LE(kept.outliers, 0.7 * kept.all_outliers);
}

// Near points are worth most; only where chance explains them are they dropped.
TEST(ReliablePairs, KeepsTrueNearPoints) {
  Rng rng = TestRng();
  SyntheticOptions options;
  options.depth = {0.5, 15};
  options.baseline = 0.3;
  const Kept kept = CountKept(options, rng);
  EXPECT_GE(kept.inliers, 0.97 * kept.all_inliers);
}

TEST(ReliablePairs, NoneWithoutInliers) {
  Rng rng = TestRng();
  SyntheticOptions options;
  options.num_2d2d = 0;
  EXPECT_EQ(CountKept(options, rng).inliers, 0);
}

}  // namespace
}  // namespace raylift
