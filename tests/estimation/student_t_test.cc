#include "estimation/refinement/joint/student_t.h"

#include <cmath>
#include <numbers>
#include <vector>

#include "base/rng.h"
#include "support/matchers.h"

namespace raylift {
namespace {

// The integral over the plane of a function of the squared distance.
template <typename Function>
double OverThePlane(const Function& of_squared) {
  // With r = tan(a), so that the heaviest tails are reached.
  constexpr int kSteps = 200000;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double angle = (i + 0.5) / kSteps * 0.5 * std::numbers::pi;
    const double r = std::tan(angle);
    sum += of_squared(r * r) * 2 * std::numbers::pi * r * (1 + r * r);
  }
  return sum * 0.5 * std::numbers::pi / kSteps;
}

// The density over that at the center.
double Density(double squared, double tail) {
  if (tail < kAsGoodAsNormal) return std::exp(-0.5 * squared);
  return std::exp(-(0.5 / tail + 1) * std::log1p(tail * squared));
}

// The precision of the normal distribution that an error seems to come from, over the mean one.
double Precision(double squared, double tail) { return (1 + 2 * tail) / (1 + tail * squared); }

TEST(StudentT, IsADistribution) {
  for (const double tail : {0.0, 0.1, 0.5, 1.0}) {
    const auto density = [&](double squared) {
      return Density(squared, tail) / (2 * std::numbers::pi);
    };
    EXPECT_NEAR(OverThePlane(density), 1, 1e-4) << tail;
    // Iterated weights are of mean precision.
    EXPECT_NEAR(
        OverThePlane([&](double squared) { return density(squared) * Precision(squared, tail); }),
        1, 1e-4)
        << tail;
    // Fisher's information of the position: the mean square of the score, along one axis.
    EXPECT_NEAR(OverThePlane([&](double squared) {
                  const double precision = Precision(squared, tail);
                  return density(squared) * precision * precision * squared / 2;
                }),
                StudentInformation(tail), 1e-4)
        << tail;
    const double limit = StudentQuantile(0.01, tail);
    EXPECT_NEAR(
        OverThePlane([&](double squared) { return squared > limit ? density(squared) : 0; }), 0.01,
        1e-3)
        << tail;
  }
}

// A squared error along one axis: normal, of a variance that is drawn itself.
double DrawSquared(int degrees, Rng& rng) {
  double chi_squared = 0;
  for (int i = 0; i < degrees; ++i) {
    const double e = rng.Normal();
    chi_squared += e * e;
  }
  const double e = rng.Normal();
  return degrees == 0 ? e * e : e * e * degrees / chi_squared;
}

TEST(StudentT, TellsTheTailFromErrorsOfAnyScale) {
  Rng rng = TestRng();
  for (const int degrees : {0, 10, 4, 2, 1}) {
    for (const double scale : {0.01, 1.0, 50.0}) {
      std::vector<double> squared;
      for (int i = 0; i < 3000; ++i) squared.push_back(scale * DrawSquared(degrees, rng));
      const double tail = EstimateTail(squared, std::nullopt);
      // Three standard deviations of the some 300 errors that are looked at.
      const double expected = degrees == 0 ? 0 : 1.0 / degrees;
      EXPECT_NEAR(tail, expected, 0.1 + 0.2 * expected) << degrees;
    }
  }
}

TEST(StudentT, FollowsThePriorWhereNothingIsKnown) {
  EXPECT_NEAR(EstimateTail({}, TailPrior{.mean = 0.3, .variance = 1e-3}), 0.3, 0.03);
  EXPECT_NEAR(EstimateTail({}, std::nullopt), 0.5, 0.05);
  Rng rng = TestRng();
  std::vector<double> normal;
  for (int i = 0; i < 300; ++i) normal.push_back(DrawSquared(0, rng));
  EXPECT_LT(EstimateTail(normal, TailPrior{.mean = 0.3, .variance = 1}), 0.1);
}

}  // namespace
}  // namespace raylift
