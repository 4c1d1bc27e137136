#include "lifting/factor_belief.h"

#include <cmath>
#include <vector>

#include "base/rng.h"
#include "support/matchers.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

constexpr double kGainPx = 80;
constexpr double kNoisePx = 0.7;

// Adds matches of different places that ask for a log factor.
void Add(int other, int count, double log_factor, Rng& rng, MapMatches& map) {
  const int places = kPlacesPerSide * kPlacesPerSide;
  const auto first = static_cast<int>(rng.UniformIndex(static_cast<uint32_t>(places)));
  for (int i = 0; i < count; ++i) {
    const double noise = kNoisePx / kGainPx * rng.Normal();
    map.matches.push_back({other, (first + 7 * i) % places, log_factor + noise, kGainPx});
  }
}

// Adds some that are wrong, each in its way.
void AddWrong(int other, int count, Rng& rng, MapMatches& map) {
  for (int i = 0; i < count; ++i) Add(other, 1, rng.Uniform(-1, 1), rng, map);
}

std::vector<MapMatches> Maps(const std::vector<double>& log_factors, Rng& rng) {
  std::vector<MapMatches> maps;
  for (const double log_factor : log_factors) {
    maps.push_back({.matches = {}, .extent_px = 1000});
    for (const int other : {100, 101}) {
      Add(other, 40, log_factor, rng, maps.back());
      AddWrong(other, 10, rng, maps.back());
    }
  }
  return maps;
}

TEST(FactorBelief, RightDepthIsRight) {
  Rng rng = TestRng();
  const FactorBeliefs beliefs = BelieveFactors(Maps({0, 0, 0, 0}, rng), kNoisePx, 1);
  EXPECT_TRUE(beliefs.all_right);
  for (const FactorBelief& belief : beliefs.of_map) EXPECT_LT(std::abs(belief.log_factor), 0.01);
}

TEST(FactorBelief, FindsEachMapsFactor) {
  Rng rng = TestRng();
  const std::vector<double> log_factors = {-0.7, -0.45, -0.3, -0.2};
  const FactorBeliefs beliefs = BelieveFactors(Maps(log_factors, rng), kNoisePx, 1);
  EXPECT_FALSE(beliefs.all_right);
  for (size_t i = 0; i < log_factors.size(); ++i) {
    EXPECT_TRUE(beliefs.of_map[i].is_own);
    EXPECT_NEAR(beliefs.of_map[i].log_factor, log_factors[i], 0.01);
    EXPECT_TRUE(beliefs.of_map[i].misled.empty());
  }
}

// As a facade matched with one like it asks for.
TEST(FactorBelief, MatchesThatAreWrongTogetherMoveNoFactorThatTheOthersRuleOut) {
  Rng rng = TestRng();
  std::vector<MapMatches> maps = Maps({0, 0, 0, 0}, rng);
  maps.push_back({.matches = {}, .extent_px = 1000});
  Add(102, 29, std::log(0.47), rng, maps.back());
  const FactorBeliefs beliefs = BelieveFactors(maps, kNoisePx, 1);
  EXPECT_TRUE(beliefs.all_right);
  EXPECT_LT(std::abs(beliefs.of_map.back().log_factor), 0.02);
  EXPECT_EQ(beliefs.of_map.back().misled, std::vector<int>{102});
}

TEST(FactorBelief, FewMatchesLeaveWhatTheOtherMapsShow) {
  Rng rng = TestRng();
  std::vector<MapMatches> maps = Maps({0.6, 0.4, 0.5, 0.45, 0.55}, rng);
  maps.push_back({.matches = {}, .extent_px = 1000});
  AddWrong(102, 8, rng, maps.back());
  const FactorBelief belief = BelieveFactors(maps, kNoisePx, 1).of_map.back();
  EXPECT_FALSE(belief.is_own);
  EXPECT_NEAR(belief.log_factor, 0.5, 0.1);
  EXPECT_GT(belief.sigma, 0.03);
}

TEST(FactorBelief, RepeatedMatchesAreNoFurtherEvidence) {
  Rng rng = TestRng();
  std::vector<MapMatches> maps = Maps({0.1, 0.2, 0.3}, rng);
  const FactorBeliefs once = BelieveFactors(maps, kNoisePx, 1);
  for (MapMatches& map : maps) {
    const std::vector<FactorMatch> again = map.matches;
    map.matches.insert(map.matches.end(), again.begin(), again.end());
  }
  const FactorBeliefs twice = BelieveFactors(maps, kNoisePx, 3);
  for (size_t i = 0; i < maps.size(); ++i) {
    EXPECT_EQ(once.of_map[i].num_independent, twice.of_map[i].num_independent);
    EXPECT_NEAR(once.of_map[i].log_factor, twice.of_map[i].log_factor, 0.01);
  }
}

TEST(FactorBelief, NothingIsBelievedOfNothing) {
  EXPECT_TRUE(BelieveFactors({}, kNoisePx, 1).of_map.empty());
  const std::vector<MapMatches> maps(2);
  const FactorBeliefs beliefs = BelieveFactors(maps, kNoisePx, 1);
  for (const FactorBelief& belief : beliefs.of_map) {
    EXPECT_FALSE(belief.is_own);
    EXPECT_EQ(belief.num_independent, 0u);
  }
}

}  // namespace
}  // namespace raylift
