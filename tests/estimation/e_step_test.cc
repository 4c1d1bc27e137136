#include <cmath>

#include "estimation/refinement/joint/model.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

// Variances of `along` in the direction of an angle and of `across` at right angles to it.
Eigen::Matrix2d Ellipse(double angle, double along, double across) {
  Eigen::Matrix2d axes;
  axes << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  return axes * Eigen::Vector2d(along, across).asDiagonal() * axes.transpose();
}

TEST(SquaredAcross, TakesTheAxisThatIsBestKnown) {
  for (const double angle : {0.0, 0.3, 1.5, 2.8}) {
    const Eigen::Vector2d across(-std::sin(angle), std::cos(angle));
    const Eigen::Vector2d along(std::cos(angle), std::sin(angle));
    EXPECT_NEAR(SquaredAcross(3 * across + 70 * along, Ellipse(angle, 400, 0.25)), 36, 1e-9);
  }
  EXPECT_NEAR(SquaredAcross({3, 4}, Ellipse(0, 2, 2)), 4.5, 1e-12);
}

// The smaller eigenvalue is then less than what the larger one loses by rounding.
TEST(SquaredAcross, IsNeverNegative) {
  for (const double along : {1e12, 1e15, 1e17}) {
    for (double angle = 0.01; angle < 3; angle += 0.01) {
      const Eigen::Matrix2d covariance = Ellipse(angle, along, 1);
      if (!(covariance.determinant() > 0)) continue;
      const Eigen::Vector2d error(std::cos(angle), std::sin(angle));
      EXPECT_GE(SquaredAcross(error, covariance), 0) << along << ' ' << angle;
    }
  }
}

}  // namespace
}  // namespace raylift
