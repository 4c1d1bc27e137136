#include "estimation/noise_variance.h"

#include <cmath>

#include "support/matchers.h"

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
    EXPECT_NEAR(NoiseVariance(SquaredResiduals(rng, 1, variance, 20000), kPairNoise), variance,
                0.05 * variance);
    EXPECT_NEAR(NoiseVariance(SquaredResiduals(rng, 2, variance, 20000), kPointNoise), variance,
                0.05 * variance);
  }
}

TEST(NoiseVariance, IsNotMovedByWhatLiesFar) {
  Rng rng = TestRng();
  auto squared = SquaredResiduals(rng, 2, 0.1, 1000);
  const double alone = NoiseVariance(squared, kPointNoise);
  squared.insert(squared.end(), 1000, 50.0);
  EXPECT_EQ(NoiseVariance(squared, kPointNoise), alone);
}

TEST(NoiseVariance, GrowsBeyondTheThresholdWhereResidualsSpreadEvenly) {
  Rng rng = TestRng();
  std::vector<double> squared;
  for (int i = 0; i < 5000; ++i) squared.push_back(std::pow(rng.Uniform(0, 3), 2));
  EXPECT_GT(NoiseVariance(squared, kPairNoise), 9);
}

TEST(NoiseVariance, IsNeitherZeroNorUnknown) {
  EXPECT_DOUBLE_EQ(NoiseVariance({}, kPairNoise), 0.1) << "the prior alone";
  EXPECT_EQ(NoiseVariance(std::vector<double>(100000, 0.0), kPointNoise), 1e-4);
}

TEST(RobustLoss, EndsWithTheNoiseAndAtThreeThresholdsAtLast) {
  EXPECT_DOUBLE_EQ(RobustLoss(0.1, kPointNoise).limit, 3);
  EXPECT_DOUBLE_EQ(RobustLoss(0.1, kPairNoise).limit, 2.2);
  EXPECT_EQ(RobustLoss(5, kPointNoise).limit, 9);
}

}  // namespace
}  // namespace raylift
