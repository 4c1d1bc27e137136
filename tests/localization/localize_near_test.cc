#include "localization/localize_near.h"

#include <cmath>

#include "base/constants.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

// Predictions that are known best along an oblique line are no surer as priors, in no direction.
TEST(WithPrediction, IsNowhereSurerThanThePrediction) {
  Rng rng = TestRng();
  for (int i = 0; i < 20; ++i) {
    Matrix6d root;
    for (double& x : root.reshaped()) x = 0.1 * rng.Normal();
    root.row(rng.UniformIndex(6)) *= 10;
    const PredictedPose predicted{LookAt({1, 2, 3}, {4, rng.Uniform(0, 5), 5}),
                                  root * root.transpose()};
    const PosePriors priors = WithPrediction({}, predicted);
    const Matrix3d R = predicted.cam_from_world.rotation.toRotationMatrix();
    const Matrix3d of_center = R.transpose() * predicted.covariance.bottomRightCorner<3, 3>() * R;
    const Matrix3d more =
        Matrix3d(priors.position->sigma.array().square().matrix().asDiagonal()) - of_center;
    const double least = Eigen::SelfAdjointEigenSolver<Matrix3d>(more).eigenvalues().minCoeff();
    EXPECT_NEAR(least / of_center.trace(), 0, 1e-9);  // and touches it
    const Vector3d turns = Eigen::SelfAdjointEigenSolver<Matrix3d>(
                               Matrix3d(predicted.covariance.topLeftCorner<3, 3>()))
                               .eigenvalues();
    EXPECT_NEAR(priors.orientation->sigma_deg, kDegPerRad * std::sqrt(turns.maxCoeff()), 1e-9);
    EXPECT_LT((priors.position->position - predicted.cam_from_world.OriginInSource()).norm(), 1e-9);
  }
}

TEST(WithPrediction, StandsInPlaceOfWhatElseIsKnownOfTheDirection) {
  const Vector3d down = Vector3d::UnitY(), right = Vector3d::UnitX();
  const PosePriors priors =
      WithPrediction({.gravity = GravityPrior{down, down},
                      .heading = HeadingPrior{.right_in_world = right, .down_in_world = down},
                      .focal_sigma = 0.01},
                     {Rigid3(), Matrix6d::Identity()});
  EXPECT_TRUE(priors.position && priors.orientation && !priors.gravity && !priors.heading);
  EXPECT_EQ(priors.focal_sigma, 0.01);
}

}  // namespace
}  // namespace raylift
