#include "estimation/refinement/single_set.h"

#include <cmath>

#include "estimation/problem/normalized_problem.h"
#include "support/matchers.h"
#include "support/synthetic_problem.h"

namespace raylift {
namespace {

// Of matches with `components` normal residuals each.
std::vector<double> SquaredResiduals(Rng& rng, int components, double variance, int count) {
  std::vector<double> squared;
  for (int i = 0; i < count; ++i) {
    double sum = 0;
    for (int k = 0; k < components; ++k) sum += std::pow(rng.Normal(), 2);
    squared.push_back(variance * sum);
  }
  return squared;
}

// The deviation of a variance from n values is sqrt(2 / n) of it: 1 % here, for two residuals less.
TEST(NoiseVariance, IsThatOfNormalResiduals) {
  Rng rng = TestRng();
  for (const double variance : {0.01, 0.25, 1.0}) {
    EXPECT_NEAR(NoiseVariance(SquaredResiduals(rng, 1, variance, 20000), kModel2D2D), variance,
                0.05 * variance);
    EXPECT_NEAR(NoiseVariance(SquaredResiduals(rng, 2, variance, 20000), kModel2D3D), variance,
                0.05 * variance);
  }
}

TEST(NoiseVariance, IsNotMovedByWhatLiesFar) {
  Rng rng = TestRng();
  auto squared = SquaredResiduals(rng, 2, 0.1, 1000);
  const double alone = NoiseVariance(squared, kModel2D3D);
  squared.insert(squared.end(), 1000, 50.0);
  EXPECT_EQ(NoiseVariance(squared, kModel2D3D), alone);
}

TEST(NoiseVariance, GrowsBeyondTheThresholdWhereResidualsSpreadEvenly) {
  Rng rng = TestRng();
  std::vector<double> squared;
  for (int i = 0; i < 5000; ++i) squared.push_back(std::pow(rng.Uniform(0, 3), 2));
  EXPECT_GT(NoiseVariance(squared, kModel2D2D), 9);
}

TEST(NoiseVariance, IsNeitherZeroNorUnknown) {
  EXPECT_DOUBLE_EQ(NoiseVariance({}, kModel2D2D), 0.1) << "the prior alone";
  EXPECT_EQ(NoiseVariance(std::vector<double>(100000, 0.0), kModel2D3D), 1e-4);
}

TEST(RobustLoss, EndsWithTheNoiseAndAtThreeThresholdsAtLast) {
  EXPECT_DOUBLE_EQ(RobustLoss(0.1, kModel2D3D).limit, 3);
  EXPECT_DOUBLE_EQ(RobustLoss(0.1, kModel2D2D).limit, 2.2);
  EXPECT_EQ(RobustLoss(5, kModel2D3D).limit, 9);
}

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
    const NormalizedProblem prepared(made.problem, 4, 2, rng);
    const CamFromLocal truth = prepared.ToLocal(made.query_from_world);
    const std::vector<double> squared = ComputeResiduals(prepared, truth).of_2d2d;
    const auto is_outlier = [&](int pair) {
      return static_cast<bool>(made.is_outlier_2d2d[prepared.matches_2d2d[pair].match]);
    };
    for (int i = 0; i < static_cast<int>(squared.size()); ++i) {
      if (squared[i] < kLimit) ++(is_outlier(i) ? kept.all_outliers : kept.all_inliers);
    }
    for (const int i : ReliableMatches2D2D(prepared, truth, squared, kVariance, kLimit)) {
      ++(is_outlier(i) ? kept.outliers : kept.inliers);
    }
  }
  return kept;
}

TEST(ReliableMatches2D2D, KeepsInliersAndDropsWhatIsNearByChance) {
  Rng rng = TestRng();
  const Kept kept = CountKept(RegimeByName("many_outliers").options, rng);
  EXPECT_GE(kept.inliers, 0.97 * kept.all_inliers);
  // The others lie among the true points and pull no harder than these.
  EXPECT_LE(kept.outliers, 0.7 * kept.all_outliers);
}

// Near points are worth most; only where chance explains them are they dropped.
TEST(ReliableMatches2D2D, KeepsTrueNearPoints) {
  Rng rng = TestRng();
  SyntheticOptions options;
  options.depth = {0.5, 15};
  options.baseline = 0.3;
  const Kept kept = CountKept(options, rng);
  EXPECT_GE(kept.inliers, 0.97 * kept.all_inliers);
}

TEST(ReliableMatches2D2D, NoneWithoutInliers) {
  Rng rng = TestRng();
  SyntheticOptions options;
  options.num_2d2d = 0;
  EXPECT_EQ(CountKept(options, rng).inliers, 0);
}

}  // namespace
}  // namespace raylift
