// The joint refinement on scenes whose mistakes come together: as accurate as the better kind of
// matches alone, and as sure as it may be.

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "estimation/refinement/refinement.h"
#include "estimation/standard_options.h"
#include "support/coherent_problem.h"
#include "support/matchers.h"

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

#ifdef __SANITIZE_ADDRESS__
constexpr int kJointProblems = 6;
#else
constexpr int kJointProblems = 40;
#endif

using Vector6d = Eigen::Matrix<double, 6, 1>;

// What Adaptive reaches on problems of a kind, beside the better of its parts.
struct Outcome {
  double log_ratio = 0;          // of the position errors, Adaptive's over the better part's, mean
  double normalized_square = 0;  // mean
  std::vector<PoseEstimate> estimates;
};

Outcome Try(const CoherentOptions& options, Method better_part) {
  Rng rng = TestRng();
  Outcome outcome;
  for (int i = 0; i < kJointProblems; ++i) {
    const CoherentProblem made = MakeCoherentProblem("coherent", options, rng);
    EstimatorOptions estimator;
    const PoseEstimate adaptive = MakePoseEstimator(estimator)->Estimate(made.problem);
    estimator.method = better_part;
    const PoseEstimate part = MakePoseEstimator(estimator)->Estimate(made.problem);
    EXPECT_TRUE(adaptive.cam_from_world && adaptive.covariance && part.cam_from_world);
    if (!adaptive.cam_from_world || !adaptive.covariance || !part.cam_from_world) continue;
    EXPECT_EQ(adaptive.verdict, PoseVerdict::kLocalized);
    outcome.log_ratio += std::log(PositionError(adaptive, made.query_from_world) /
                                  PositionError(part, made.query_from_world)) /
                         kJointProblems;
    const Vector6d error = StepBetween(made.query_from_world, *adaptive.cam_from_world);
    outcome.normalized_square +=
        error.dot(adaptive.covariance->ldlt().solve(error)) / 6 / kJointProblems;
    outcome.estimates.push_back(adaptive);
  }
  return outcome;
}

// Of the mean of kJointProblems logarithms that vary by some 0.6: two standard deviations, above the
// logarithm of 1.05.
const double kLargestLogRatio = std::log(1.05) + 2 * 0.6 / std::sqrt(kJointProblems);
// Of the mean of kJointProblems chi-squared distances of six degrees over six: three standard
// deviations, and what is within the aim.
const double kSpread = 3 * std::sqrt(2.0 / 6 / kJointProblems);

void ExpectCalibrated(const Outcome& outcome) {
  EXPECT_GT(outcome.normalized_square, 0.7 - kSpread);
  EXPECT_LT(outcome.normalized_square, 1.4 + kSpread);
}

TEST(JointRefinement, IsAsGoodAsPointsWhereGeometryIsExact) {
  const Outcome outcome = Try({}, Method::kP3p);
  EXPECT_LT(outcome.log_ratio, kLargestLogRatio);
  ExpectCalibrated(outcome);
}

// So many that a part of them starts the refinement.
TEST(JointRefinement, IsAsGoodWithManyKeypoints) {
  const Outcome outcome = Try({.num_keypoints = 1200, .num_references = 2}, Method::kP3p);
  EXPECT_LT(outcome.log_ratio, kLargestLogRatio);
  ExpectCalibrated(outcome);
}

TEST(JointRefinement, IsAsSureAsItMayBeOfKeypointsWithHeavyTails) {
  const Outcome outcome =
      Try({.num_keypoints = 150, .sigma_px = 0.4, .tail_degrees = 2}, Method::kP3p);
  EXPECT_LT(outcome.log_ratio, kLargestLogRatio);
  ExpectCalibrated(outcome);
}

TEST(JointRefinement, IsNotMisledByWhatRepeats) {
  const Outcome many = Try({.repeated = 0.35}, Method::kP3p);
  EXPECT_LT(many.log_ratio, kLargestLogRatio);
  ExpectCalibrated(many);
  const Outcome two = Try({.num_references = 2, .repeated = 0.35}, Method::kP3p);
  EXPECT_LT(two.log_ratio, kLargestLogRatio);
  ExpectCalibrated(two);
}

TEST(JointRefinement, IsAsGoodAsPairsWhereReferencesHaveFactors) {
  const Outcome outcome =
      Try({.vertical = 0.5, .reference_factor = 0.08, .surface = 0.03}, Method::kE5p1);
  EXPECT_LT(outcome.log_ratio, kLargestLogRatio);
  ExpectCalibrated(outcome);
  for (const PoseEstimate& estimate : outcome.estimates) {
    ASSERT_TRUE(estimate.noise);
    EXPECT_GT(estimate.noise->reference_factor, 0.02);
    EXPECT_NEAR(estimate.noise->common_depth, 0.03, 0.02);
  }
}

TEST(JointRefinement, TellsWhatReferencesHaveInCommonFromTheirOwnErrors) {
  const Outcome outcome = Try({.surface = 0.02}, Method::kE5p1);
  EXPECT_LT(outcome.log_ratio, kLargestLogRatio);
  ExpectCalibrated(outcome);
  for (const PoseEstimate& estimate : outcome.estimates) {
    ASSERT_TRUE(estimate.noise);
    EXPECT_NEAR(estimate.noise->common_depth, 0.02, 0.006);
    EXPECT_LT(estimate.noise->depth, 0.01);
  }
}

TEST(JointRefinement, EstimatesErrorsOfTheReferencesPoses) {
  const Outcome outcome = Try({.reference_deg = 0.05, .reference_position = 0.06}, Method::kP3p);
  EXPECT_LT(outcome.log_ratio, kLargestLogRatio);
  EXPECT_LT(outcome.normalized_square, 2);
  for (const PoseEstimate& estimate : outcome.estimates) {
    ASSERT_TRUE(estimate.noise);
    EXPECT_GT(estimate.noise->reference_position, 0.01);
  }
}

TEST(JointRefinement, EstimatesTheKeypointsNoise) {
  for (const double sigma_px : {0.3, 0.7, 1.5}) {
    Rng rng = TestRng();
    const CoherentProblem made = MakeCoherentProblem("noise", {.sigma_px = sigma_px}, rng);
    const PoseEstimate estimate = MakePoseEstimator({})->Estimate(made.problem);
    ASSERT_TRUE(estimate.noise);
    EXPECT_NEAR(estimate.noise->keypoint_px, sigma_px, 0.1 * sigma_px);
  }
}

TEST(JointRefinement, CountsAKeypointOnceHoweverOftenItIsMatched) {
  // Every match twice: nothing new is known.
  Rng rng = TestRng();
  const CoherentProblem once = MakeCoherentProblem("once", {.wrong = 0}, rng);
  CoherentProblem twice = once;
  const size_t count = once.problem.matches_2d2d.size();
  for (const Match2D2D& match : once.problem.matches_2d2d) {
    twice.problem.matches_2d2d.push_back(match);
  }
  for (const Match2D3D& match : once.problem.matches_2d3d) {
    twice.problem.matches_2d3d.push_back(match);
    *twice.problem.matches_2d3d.back().match_2d2d += count;
  }
  const PoseEstimate of_once = MakePoseEstimator({})->Estimate(once.problem);
  const PoseEstimate of_twice = MakePoseEstimator({})->Estimate(twice.problem);
  ASSERT_TRUE(of_once.covariance && of_twice.covariance);
  EXPECT_GT(of_twice.position_sigma, 0.9 * of_once.position_sigma);
}

TEST(JointRefinement, TakesPointsOfOtherOriginWhereReferencesDisagree) {
  // Half of the keypoints have a 3D point of SfM instead of lifted ones, and the references are
  // off.
  Rng rng = TestRng();
  double sum = 0;
  for (int i = 0; i < kJointProblems; ++i) {
    CoherentProblem made = MakeCoherentProblem(
        "loose", {.wrong = 0, .reference_deg = 0.05, .reference_position = 0.06}, rng);
    std::vector<bool> seen(300, false);
    std::vector<Match2D3D> points;
    for (const Match2D3D& match : made.problem.matches_2d3d) {
      const auto keypoint = static_cast<size_t>(*match.query_keypoint);
      if (keypoint % 2 == 0) {
        points.push_back(match);
      } else if (!seen[keypoint]) {
        seen[keypoint] = true;
        points.push_back(match);
        points.back().match_2d2d.reset();
        points.back().reference.reset();
        points.back().point_in_world +=
            0.02 * Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal());
      }
    }
    made.problem.matches_2d3d = points;
    const PoseEstimate estimate = MakePoseEstimator({})->Estimate(made.problem);
    ASSERT_TRUE(estimate.cam_from_world && estimate.covariance);
    const Vector6d error = StepBetween(made.query_from_world, *estimate.cam_from_world);
    sum += error.dot(estimate.covariance->ldlt().solve(error)) / 6 / kJointProblems;
  }
  EXPECT_LT(sum, 2.5);
}

}  // namespace
}  // namespace raylift
