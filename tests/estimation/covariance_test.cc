// The pose covariance against the errors that it predicts: for a correct one the squared
// Mahalanobis distance of the error is chi-squared with six degrees of freedom, of mean 6.

#include <cmath>

#include "estimation/standard_options.h"
#include "support/matchers.h"
#include "support/synthetic_problem.h"

#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

#ifdef __SANITIZE_ADDRESS__
constexpr int kCovarianceProblems = 30;
#else
constexpr int kCovarianceProblems = 200;
#endif

using Vector6d = Eigen::Matrix<double, 6, 1>;

// The query's focal length is wrong by errors of this share, which the problem knows.
double MeanSquaredMahalanobis(Method method, const SyntheticOptions& synthetic,
                              double focal_sigma = 0) {
  Rng rng = TestRng();
  double sum = 0;
  for (int i = 0; i < kCovarianceProblems; ++i) {
    SyntheticProblem made = MakeSyntheticProblem("covariance", synthetic, rng);
    if (focal_sigma > 0) {
      const Camera& camera = made.problem.query_camera;
      std::vector<double> params(camera.params().begin(), camera.params().end());
      const double factor = 1 + focal_sigma * rng.Normal();
      params[0] *= factor;
      params[1] *= factor;
      made.problem.query_camera = {camera.model(), camera.width_px(), camera.height_px(), params};
      made.problem.priors.focal_sigma = focal_sigma;
    }
    const PoseEstimate estimate = EstimateWith(method, made.problem);
    EXPECT_TRUE(estimate.covariance);
    if (!estimate.covariance) continue;
    const Vector6d error = StepBetween(made.query_from_world, *estimate.cam_from_world);
    sum += error.dot(estimate.covariance->ldlt().solve(error));
  }
  return sum / kCovarianceProblems;
}

// Three standard deviations of the mean of so many distances, and a bias: the noise is estimated
// per problem from its inliers among outliers, and the robust loss costs up to a tenth.
const double kTolerance = 3 * std::sqrt(12.0 / kCovarianceProblems) + 0.75;

SyntheticOptions FewMatches() {
  SyntheticOptions options;
  options.num_2d3d = 200;
  options.num_2d2d = 400;
  return options;
}

TEST(Covariance, PredictsTheErrorsOfP3p) {
  EXPECT_NEAR(MeanSquaredMahalanobis(Method::kP3p, FewMatches()), 6, kTolerance);
}

TEST(Covariance, PredictsTheErrorsOfE5p1) {
  EXPECT_NEAR(MeanSquaredMahalanobis(Method::kE5p1, FewMatches()), 6, kTolerance);
}

TEST(Covariance, PredictsTheErrorsOfAdaptive) {
  EXPECT_NEAR(MeanSquaredMahalanobis(Method::kAdaptive, FewMatches()), 6, kTolerance);
}

TEST(Covariance, HoldsAFocalLengthThatIsUncertain) {
  for (const Method method : {Method::kP3p, Method::kAdaptive}) {
    EXPECT_NEAR(MeanSquaredMahalanobis(method, FewMatches(), 0.005), 6, kTolerance)
        << ToString(method);
  }
}

TEST(Covariance, StandardDeviationsFollowFromIt) {
  Rng rng = TestRng();
  const SyntheticProblem made = MakeSyntheticProblem("covariance", FewMatches(), rng);
  const PoseEstimate estimate = EstimateWith(Method::kAdaptive, made.problem);
  ASSERT_TRUE(estimate.covariance);
  // The center is -R' t; a step (w, v) moves it by -R' v.
  const Eigen::Matrix3d rotation = estimate.cam_from_world->rotation.toRotationMatrix();
  const Eigen::Matrix3d center =
      rotation.transpose() * estimate.covariance->bottomRightCorner<3, 3>() * rotation;
  EXPECT_NEAR(estimate.position_sigma, std::sqrt(center.trace()), 1e-12);
  EXPECT_NEAR(estimate.rotation_sigma_deg,
              std::sqrt(estimate.covariance->topLeftCorner<3, 3>().trace()) * 180 / std::acos(-1),
              1e-12);
}

}  // namespace
}  // namespace raylift
