#include "estimation/solvers/polynomial_roots.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "support/matchers.h"

namespace raylift {
namespace {

// The monic polynomial with these real roots and the factors x^2 + b x + c.
struct QuadraticFactor {
  double b, c;
};
template <int kDegree>
std::array<double, kDegree + 1> PolynomialOf(const std::vector<double>& roots,
                                             const std::vector<QuadraticFactor>& factors) {
  std::array<double, kDegree + 1> p{};
  p[0] = 1;
  const auto times = [&p](double linear, double constant, double quadratic) {
    std::array<double, kDegree + 1> product{};
    for (int i = 0; i <= kDegree; ++i) {
      product[i] += constant * p[i];
      if (i + 1 <= kDegree) product[i + 1] += linear * p[i];
      if (i + 2 <= kDegree) product[i + 2] += quadratic * p[i];
    }
    p = product;
  };
  for (const double root : roots) times(1, -root, 0);
  for (const QuadraticFactor& f : factors) times(f.b, f.c, 1);
  return p;
}

TEST(RealRoots, TenSeparateRootsAreFound) {
  const std::vector<double> roots = {-9, -7.5, -3, -1, -0.5, 0.25, 2, 4, 6, 8};
  std::array<double, 10> found;
  ASSERT_EQ(RealRoots<10>(PolynomialOf<10>(roots, {}), found), 10);
  for (int i = 0; i < 10; ++i) {
    EXPECT_NEAR(found[i], roots[i], 1e-9);
  }
}

TEST(RealRoots, ComplexPairsAreLeftOut) {
  const auto p = PolynomialOf<10>({-2, 0.5}, {{0, 1}, {1, 3}, {-2, 5}, {4, 9}});
  std::array<double, 10> found;
  ASSERT_EQ(RealRoots<10>(p, found), 2);
  EXPECT_NEAR(found[0], -2, 1e-12);
  EXPECT_NEAR(found[1], 0.5, 1e-12);
}

TEST(RealRoots, NoneWithoutRealRoots) {
  std::array<double, 4> found;
  EXPECT_EQ(RealRoots<4>(PolynomialOf<4>({}, {{0, 1}, {1, 3}}), found), 0);
}

TEST(RealRoots, RootsOfVeryDifferentSizeAreFound) {
  const std::vector<double> roots = {-1e4, -1e-4, 1e-3, 1e3};
  std::array<double, 4> found;
  ASSERT_EQ(RealRoots<4>(PolynomialOf<4>(roots, {}), found), 4);
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(found[i], roots[i], 1e-9 * std::abs(roots[i]));
  }
}

TEST(RealRoots, NothingForNonsense) {
  std::array<double, 2> found;
  EXPECT_EQ(RealRoots<2>({1, 1, 0}, found), 0) << "no leading coefficient";
  EXPECT_EQ(RealRoots<2>({0, 0, 0}, found), 0);
  EXPECT_EQ(RealRoots<2>({1, std::numeric_limits<double>::quiet_NaN(), 1}, found), 0);
  EXPECT_EQ(RealRoots<2>({1, std::numeric_limits<double>::infinity(), 1}, found), 0);
}

TEST(RealRoots, ADoubleRootNeverHangsOrGivesNan) {
  std::array<double, 4> found;
  const int count = RealRoots<4>(PolynomialOf<4>({1, 1, 3, 3}, {}), found);
  for (int i = 0; i < count; ++i) {
    EXPECT_TRUE(std::isfinite(found[i]));
  }
}

TEST(RealRoots, RandomPolynomialsGiveAllTheirRoots) {
  Rng rng = TestRng();
  int missed = 0;
  constexpr int kTrials = 5000;
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<double> roots;
    for (int i = 0; i < 4; ++i) roots.push_back(rng.Uniform(-5, 5));
    std::sort(roots.begin(), roots.end());
    std::vector<QuadraticFactor> factors;
    for (int i = 0; i < 3; ++i) {
      const double b = rng.Uniform(-2, 2);
      factors.push_back({b, 0.25 * b * b + rng.Uniform(0.1, 3)});
    }
    std::array<double, 10> found;
    const int count = RealRoots<10>(PolynomialOf<10>(roots, factors), found);
    bool all = count == 4;
    for (int i = 0; all && i < 4; ++i) all = std::abs(found[i] - roots[i]) < 1e-6;
    missed += all ? 0 : 1;
  }
  // Two of four random roots are nearer than rounding allows in about one case of a thousand.
  EXPECT_LT(missed, kTrials / 500);
}

}  // namespace
}  // namespace raylift
