// Estimation where not all of the input can be taken as exact: points with a known standard
// deviation, and a query of unknown focal length.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "estimation/standard_options.h"
#include "support/coherent_problem.h"
#include "support/matchers.h"
#include "support/synthetic_problem.h"
#include <Eigen/Cholesky>

#include "raylift/base/error.h"
#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

double MedianPositionError(const std::vector<SyntheticProblem>& problems,
                           const EstimatorOptions& options) {
  const auto estimator = MakePoseEstimator(options);
  std::vector<double> errors;
  for (const SyntheticProblem& synthetic : problems) {
    const PoseEstimate estimate = estimator->Estimate(synthetic.problem);
    errors.push_back(estimate.cam_from_world ? (estimate.cam_from_world->OriginInSource() -
                                                synthetic.query_from_world.OriginInSource())
                                                   .norm()
                                             : std::numeric_limits<double>::infinity());
  }
  std::sort(errors.begin(), errors.end());
  return errors[errors.size() / 2];
}

TEST(PointSigma, MakesNoisyGeometryUsable) {
  const auto problems = MakeRegime(RegimeByName("noisy_points"), 10);
  EstimatorOptions options = StandardOptions(Method::kP3p);
  const double exact = MedianPositionError(problems, options);
  options.point_sigma = 0.3;
  // 0.56 m against 0.10 m over the whole regime.
  EXPECT_LT(MedianPositionError(problems, options), 0.5 * exact);
}

TEST(LearnedDepthSigma, CountsInTheJointRefinementAlone) {
  Rng rng = TestRng();
  PoseProblem plain = MakeCoherentProblem("learned", {.surface = 0.02}, rng).problem;
  PoseProblem learned = plain;
  for (size_t i = 0; i < learned.matches_2d3d.size(); ++i) {
    learned.matches_2d3d[i].log_depth_sigma = i % 3 == 0 ? 0.3 : 0.005;
  }
  const auto estimates = [&](Method method) {
    const auto estimator = MakePoseEstimator(StandardOptions(method));
    return std::pair(estimator->Estimate(plain), estimator->Estimate(learned));
  };
  for (const Method method :
       {Method::kP3p, Method::kE5p1, Method::kSelect, Method::kHybridRansac, Method::kHloc}) {
    const auto [without, with] = estimates(method);
    ASSERT_TRUE(without.cam_from_world && with.cam_from_world) << ToString(method);
    EXPECT_TRUE(IsIdentical(without, with)) << ToString(method);
  }
  const auto [without, with] = estimates(Method::kAdaptive);
  ASSERT_TRUE(without.cam_from_world && with.cam_from_world);
  EXPECT_EQ(without.ransac_value, with.ransac_value);
  EXPECT_NE(without.cam_from_world->translation, with.cam_from_world->translation);
}

TEST(PointSigma, OfAMatchGoesBeforeThatOfTheOptions) {
  SyntheticProblem synthetic = MakeRegime(RegimeByName("noisy_points"), 1).front();
  EstimatorOptions options = StandardOptions(Method::kP3p);
  options.point_sigma = 0.3;
  const PoseEstimate by_option = MakePoseEstimator(options)->Estimate(synthetic.problem);
  for (Match2D3D& match : synthetic.problem.matches_2d3d) {
    match.point_sigma = 0.3;
  }
  options.point_sigma = 100;
  const PoseEstimate by_match = MakePoseEstimator(options)->Estimate(synthetic.problem);
  ASSERT_TRUE(by_option.cam_from_world && by_match.cam_from_world);
  EXPECT_TRUE(IsNearPose(*by_match.cam_from_world, *by_option.cam_from_world, 1e-12, 1e-12));
  EXPECT_EQ(by_match.inliers_2d3d, by_option.inliers_2d3d);
}

// Three in four references are turned at random by half a degree about each axis, which moves a
// keypoint by five pixels, and marked as uncertain by that.
std::vector<SyntheticProblem> MakeProblemsWithUncertainReferences(int count) {
  constexpr double kSigma = 0.5 * std::numbers::pi / 180;
  auto problems = MakeRegime(RegimeByName("accurate"), count);
  Rng rng = TestRng();
  for (SyntheticProblem& synthetic : problems) {
    PoseProblem& problem = synthetic.problem;
    problem.matches_2d3d.clear();
    const size_t num_uncertain = problem.references.size() * 3 / 4;
    for (size_t i = 0; i < num_uncertain; ++i) {
      const double x = kSigma * rng.Normal();
      const double y = kSigma * rng.Normal();
      const double z = kSigma * rng.Normal();
      Rigid3& pose = problem.references[i].cam_from_world;
      pose = Rigid3{RotationFromVector({x, y, z}), Eigen::Vector3d::Zero()} * pose;
    }
    for (Match2D2D& match : problem.matches_2d2d) {
      if (static_cast<size_t>(match.reference) < num_uncertain) {
        match.reference_sigma_px = kSigma * problem.query_camera.MeanFocalPx();
      }
    }
  }
  return problems;
}

TEST(ReferenceSigma, KeepsUncertainReferencesFromSpoilingThePose) {
  auto problems = MakeProblemsWithUncertainReferences(20);
  const EstimatorOptions options = StandardOptions(Method::kE5p1);
  const double weighed = MedianPositionError(problems, options);
  for (SyntheticProblem& synthetic : problems) {
    for (Match2D2D& match : synthetic.problem.matches_2d2d) match.reference_sigma_px.reset();
  }
  const double trusted = MedianPositionError(problems, options);
  // 1.4 cm against 2.8 cm over 40 problems.
  EXPECT_LT(weighed, 0.65 * trusted) << weighed << " against " << trusted;
}

TEST(ReferenceSigma, OfZeroChangesNothing) {
  SyntheticProblem synthetic = MakeRegime(RegimeByName("accurate"), 1).front();
  const auto estimator = MakePoseEstimator(StandardOptions(Method::kAdaptive));
  const PoseEstimate exact = estimator->Estimate(synthetic.problem);
  for (Match2D2D& match : synthetic.problem.matches_2d2d) match.reference_sigma_px = 0;
  const PoseEstimate marked = estimator->Estimate(synthetic.problem);
  ASSERT_TRUE(exact.cam_from_world && marked.cam_from_world);
  EXPECT_TRUE(IsNearPose(*marked.cam_from_world, *exact.cam_from_world, 0, 0));
}

Camera WithFocalTimes(const Camera& camera, double factor) {
  std::vector<double> params(camera.params().begin(), camera.params().end());
  params[0] *= factor;
  params[1] *= factor;
  return {camera.model(), camera.width_px(), camera.height_px(), params};
}

TEST(RefineFocal, FindsAFocalLengthWithinItsRange) {
  struct Case {
    double off, range;
  };
  for (const Case& known : {Case{1.08, 1.3}, Case{1.7, 2}, Case{0.55, 2}}) {
    for (const Method method : {Method::kP3p, Method::kE5p1, Method::kAdaptive}) {
      for (SyntheticProblem& synthetic : MakeRegime(RegimeByName("accurate"), 1)) {
        const Camera true_camera = synthetic.problem.query_camera;
        synthetic.problem.query_camera = WithFocalTimes(true_camera, known.off);
        EstimatorOptions options = StandardOptions(method);
        options.refine_focal = true;
        options.focal_range = known.range;
        const PoseEstimate estimate = MakePoseEstimator(options)->Estimate(synthetic.problem);
        ASSERT_TRUE(estimate.cam_from_world && estimate.refined_camera);
        // 900 inliers of one pixel's noise fix the focal length to about 0.1 %.
        EXPECT_NEAR(estimate.refined_camera->focal_x_px() / true_camera.focal_x_px(), 1, 5e-3);
        EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, synthetic.query_from_world, 0.2, 0.05));
      }
    }
  }
}

// What is not known of one query's camera is told by its problem.
TEST(RefineFocal, IsAskedForByAProblem) {
  for (SyntheticProblem& synthetic : MakeRegime(RegimeByName("accurate"), 1)) {
    const EstimatorOptions options = StandardOptions(Method::kAdaptive);
    const Camera true_camera = synthetic.problem.query_camera;
    synthetic.problem.query_camera = WithFocalTimes(true_camera, 0.6);
    synthetic.problem.priors.focal_range = 2;
    const PoseEstimate estimate = MakePoseEstimator(options)->Estimate(synthetic.problem);
    ASSERT_TRUE(estimate.refined_camera);
    EXPECT_NEAR(estimate.refined_camera->focal_x_px() / true_camera.focal_x_px(), 1, 5e-3);
  }
}

TEST(RefineFocal, StaysWithinItsRange) {
  SyntheticProblem synthetic = MakeRegime(RegimeByName("accurate"), 1).front();
  const double true_px = synthetic.problem.query_camera.focal_x_px();
  const Camera camera = synthetic.problem.query_camera;
  for (const Refinement refinement : {Refinement::kRobust, Refinement::kPaper}) {
    for (const double range : {1.1, 1.4}) {
      synthetic.problem.query_camera = WithFocalTimes(camera, 1.02 * range);
      EstimatorOptions options = StandardOptions(Method::kAdaptive);
      options.refinement = refinement;
      options.refine_focal = true;
      options.focal_range = range;
      const PoseEstimate estimate = MakePoseEstimator(options)->Estimate(synthetic.problem);
      ASSERT_TRUE(estimate.refined_camera) << range;
      EXPECT_NEAR(estimate.refined_camera->focal_x_px(), true_px * 1.02, 2e-3 * true_px) << range;
      EXPECT_GE(estimate.refined_camera->focal_x_px(), true_px * 1.02 * (1 - 1e-9)) << range;
      // The paper's refinement does not tell how uncertain the focal length leaves the position.
      EXPECT_EQ(estimate.confidence > 0.5, refinement == Refinement::kRobust) << range;
    }
  }
}

TEST(RefineFocal, OfLensesWithDistortionAndMethodsThatUseOthers) {
  for (SyntheticProblem& synthetic : MakeRegime(RegimeByName("accurate"), 1)) {
    PoseProblem& problem = synthetic.problem;
    const Camera pinhole = problem.query_camera;
    const auto barrel = [&](double focal_px) {
      const double params[] = {focal_px, pinhole.principal_point_px().x(),
                               pinhole.principal_point_px().y(), -0.1};
      return Camera(CameraModel::kSimpleRadial, pinhole.width_px(), pinhole.height_px(), params);
    };
    const Camera truth = barrel(pinhole.focal_x_px());
    const auto distort = [&](Eigen::Vector2d& px) {
      if (const auto ray = pinhole.RayInCam(px)) px = truth.ImgFromCam(*ray).value_or(px);
    };
    for (Match2D2D& match : problem.matches_2d2d) distort(match.query_px);
    for (Match2D3D& match : problem.matches_2d3d) distort(match.query_px);
    problem.query_camera = barrel(0.6 * pinhole.focal_x_px());
    problem.priors.focal_range = 2;
    for (const Method method : {Method::kAdaptive, Method::kSelect, Method::kHloc}) {
      const PoseEstimate estimate = MakePoseEstimator(StandardOptions(method))->Estimate(problem);
      ASSERT_TRUE(estimate.refined_camera && estimate.cam_from_world) << ToString(method);
      EXPECT_NEAR(estimate.refined_camera->focal_x_px() / truth.focal_x_px(), 1, 0.01)
          << ToString(method);
    }
  }
}

// Problems as seen through `lens`, of which no more than the size and a focal length within a
// factor of two are known.
std::vector<SyntheticProblem> OfUnknownLens(const std::vector<double>& lens, int count) {
  std::vector<SyntheticProblem> problems = MakeRegime(RegimeByName("accurate"), count);
  for (SyntheticProblem& synthetic : problems) {
    PoseProblem& problem = synthetic.problem;
    const Camera pinhole = problem.query_camera;
    const int width_px = pinhole.width_px(), height_px = pinhole.height_px();
    const double focal_px = pinhole.focal_x_px();
    const Camera truth(CameraModel::kRadial, width_px, height_px,
                       std::vector{focal_px, 0.5 * width_px + lens[0], 0.5 * height_px + lens[1],
                                   lens[2], lens[3]});
    const auto distort = [&](Eigen::Vector2d& px) {
      if (const auto ray = pinhole.RayInCam(px)) px = truth.ImgFromCam(*ray).value_or(px);
    };
    for (Match2D2D& match : problem.matches_2d2d) distort(match.query_px);
    for (Match2D3D& match : problem.matches_2d3d) distort(match.query_px);
    problem.query_camera = Camera(CameraModel::kSimplePinhole, width_px, height_px,
                                  std::vector{1.3 * focal_px, 0.5 * width_px, 0.5 * height_px});
    problem.priors.focal_range = 2;
  }
  return problems;
}

// Of a photograph whose camera is not known, the whole lens is found with the pose.
TEST(AssumedLens, IsFoundWithThePoseAndStandsInItsCovariance) {
  for (const std::vector<double>& lens :
       {std::vector{0., 0., 0., 0.}, {9., -7., -0.19, 0.045}, {-6., 4., 0.06, 0.}}) {
    double squared_sigmas = 0;
    constexpr int kProblems = 8;
    for (const SyntheticProblem& synthetic : OfUnknownLens(lens, kProblems)) {
      const PoseEstimate estimate =
          MakePoseEstimator(StandardOptions(Method::kAdaptive))->Estimate(synthetic.problem);
      ASSERT_TRUE(estimate.cam_from_world && estimate.covariance);
      const double error =
          (estimate.cam_from_world->OriginInSource() - synthetic.query_from_world.OriginInSource())
              .norm();
      EXPECT_LT(error, 4 * estimate.position_sigma) << lens[2];
      squared_sigmas += error * error / (estimate.position_sigma * estimate.position_sigma);
    }
    // 1 on average.
    EXPECT_LT(squared_sigmas / kProblems, 3) << lens[2];
    EXPECT_GT(squared_sigmas / kProblems, 0.3) << lens[2];
  }
}

// A lens that is a guess leaves open how far away all is; a range tells it.
TEST(AssumedLens, ARangeTellsHowFarAwayAllIs) {
  double without = 0, with = 0;  // sums of errors along the optical axis
  for (SyntheticProblem& synthetic : OfUnknownLens({9, -7, -0.19, 0.045}, 5)) {
    PoseProblem& problem = synthetic.problem;
    const auto estimator = MakePoseEstimator(StandardOptions(Method::kAdaptive));
    const Rigid3& truth = synthetic.query_from_world;
    const auto error = [&](const PoseEstimate& estimate) {
      return std::abs((estimate.cam_from_world.value() * truth.OriginInSource()).z());
    };
    const PoseEstimate alone = estimator->Estimate(problem);
    const double sigma = std::sqrt(alone.covariance.value()(5, 5));
    const Eigen::Vector3d axis = truth.rotation.conjugate() * Eigen::Vector3d::UnitZ();
    problem.priors.range = {.range = 5,
                            .sigma = sigma / 10,
                            .plane = RangePrior::Plane{truth.OriginInSource() + 5 * axis, axis}};
    const PoseEstimate ranged = estimator->Estimate(problem);
    EXPECT_LT(std::sqrt(ranged.covariance.value()(5, 5)), sigma / 3);
    without += error(alone);
    with += error(ranged);
  }
  EXPECT_LT(with, without / 2) << with << " against " << without;
}

// Without points nothing tells the lens: a pose is not sure, however well its matches fit.
TEST(AssumedLens, LeavesPosesDoubtfulThatNoPointTells) {
  for (SyntheticProblem& synthetic : OfUnknownLens({9, -7, -0.19, 0.045}, 3)) {
    synthetic.problem.matches_2d3d.clear();
    const PoseEstimate estimate =
        MakePoseEstimator(StandardOptions(Method::kAdaptive))->Estimate(synthetic.problem);
    EXPECT_EQ(estimate.verdict, PoseVerdict::kDoubtful);
  }
}

TEST(RefineFocal, WhereNoPoseIsFoundTheReasonIs) {
  SyntheticProblem synthetic = MakeRegime(RegimeByName("accurate"), 1).front();
  PoseProblem& problem = synthetic.problem;
  problem.matches_2d2d.resize(2);
  problem.matches_2d3d.resize(2);
  problem.priors.focal_range = 2;
  for (const EnumName<Method>& method : kEnumNames<Method>) {
    const PoseEstimate estimate =
        MakePoseEstimator(StandardOptions(method.value))->Estimate(problem);
    EXPECT_FALSE(estimate.cam_from_world) << method.name;
    EXPECT_EQ(estimate.failure, FailureReason::kTooFewMatches) << method.name;
    EXPECT_EQ(estimate.inliers_2d3d.size(), 2u) << method.name;
    EXPECT_EQ(estimate.score_2d2d.num_matches, 2) << method.name;
  }
}

TEST(RefineFocal, ARangeThatHoldsNoNumbersIsNamed) {
  PoseProblem problem = MakeRegime(RegimeByName("accurate"), 1).front().problem;
  problem.priors.focal_range = 2;
  for (const double focal_px : {5e-324, 1.7e308}) {
    const double params[] = {500, focal_px, 320, 240};
    problem.query_camera = Camera(CameraModel::kPinhole, 640, 480, params);
    EXPECT_TRUE(FailsWithInputError(
        [&] { MakePoseEstimator(StandardOptions(Method::kAdaptive))->Estimate(problem); },
        {"query camera: no focal lengths within a factor of 2"}));
  }
}

TEST(FocalSigma, OfZeroOrNoneAreTheSame) {
  SyntheticProblem synthetic = MakeRegime(RegimeByName("accurate"), 1).front();
  for (const Method method : {Method::kP3p, Method::kAdaptive}) {
    const auto estimator = MakePoseEstimator(StandardOptions(method));
    synthetic.problem.priors.focal_sigma.reset();
    const PoseEstimate known = estimator->Estimate(synthetic.problem);
    synthetic.problem.priors.focal_sigma = 0;
    const PoseEstimate exact = estimator->Estimate(synthetic.problem);
    ASSERT_TRUE(known.cam_from_world && exact.cam_from_world);
    EXPECT_TRUE(IsNearPose(*exact.cam_from_world, *known.cam_from_world, 0, 0));
    EXPECT_EQ(*exact.covariance, *known.covariance);
  }
}

// The pose and its inliers are those of the true focal length, which 900 matches tell.
TEST(FocalSigma, LeavesTheCameraAndFindsThePose) {
  SyntheticProblem synthetic = MakeRegime(RegimeByName("accurate"), 1).front();
  const auto estimator = MakePoseEstimator(StandardOptions(Method::kAdaptive));
  const PoseEstimate best = estimator->Estimate(synthetic.problem);
  synthetic.problem.query_camera = WithFocalTimes(synthetic.problem.query_camera, 1.005);
  const PoseEstimate wrong = estimator->Estimate(synthetic.problem);
  synthetic.problem.priors.focal_sigma = 0.005;
  const PoseEstimate uncertain = estimator->Estimate(synthetic.problem);
  ASSERT_TRUE(best.cam_from_world && wrong.cam_from_world && uncertain.cam_from_world);
  EXPECT_FALSE(uncertain.refined_camera);
  const auto error = [&](const PoseEstimate& estimate) {
    return (estimate.cam_from_world->OriginInSource() - synthetic.query_from_world.OriginInSource())
        .norm();
  };
  EXPECT_LT(error(uncertain), 0.5 * error(wrong));
  EXPECT_GT(uncertain.position_sigma, best.position_sigma);
  EXPECT_GE(uncertain.score_2d3d.num_inliers, 0.99 * best.score_2d3d.num_inliers);
}

// Of an error d that the matches tell with the deviation s_m, a given s leaves
// d s^2 / (s^2 + s_m^2): what is left over what is taken grows as s^2.
TEST(FocalSigma, DrawsTheFocalLengthTowardTheGivenOne) {
  SyntheticProblem synthetic = MakeRegime(RegimeByName("accurate"), 1).front();
  synthetic.problem.query_camera = WithFocalTimes(synthetic.problem.query_camera, 1.005);
  const auto estimator = MakePoseEstimator(StandardOptions(Method::kAdaptive));
  const auto center = [&](double sigma) {
    synthetic.problem.priors.focal_sigma = sigma;
    return estimator->Estimate(synthetic.problem).cam_from_world.value().OriginInSource();
  };
  const Eigen::Vector3d given = center(0);
  const double free = (center(0.3) - given).norm();
  EXPECT_GT(free, 0.01);
  EXPECT_LT((center(1e-5) - given).norm(), 0.01 * free);
  const auto ratio = [&](double sigma) {
    const double moved = (center(sigma) - given).norm();
    return moved / (free - moved);
  };
  EXPECT_NEAR(ratio(4e-4) / ratio(2e-4), 4, 0.8);
}

TEST(FocalSigma, OfTheOptionsTakesThePlaceOfTheProblems) {
  SyntheticProblem synthetic = MakeRegime(RegimeByName("accurate"), 1).front();
  EstimatorOptions options = StandardOptions(Method::kAdaptive);
  synthetic.problem.priors.focal_sigma = 0.02;
  options.focal_sigma = 0;
  const PoseEstimate exact = MakePoseEstimator(options)->Estimate(synthetic.problem);
  synthetic.problem.priors.focal_sigma = 0;
  options.focal_sigma = 0.02;
  const PoseEstimate uncertain = MakePoseEstimator(options)->Estimate(synthetic.problem);
  ASSERT_TRUE(exact.covariance && uncertain.covariance);
  EXPECT_LT(exact.position_sigma, uncertain.position_sigma);
}

TEST(FocalSigma, OutOfItsRangeIsNamed) {
  PoseProblem problem = MakeRegime(RegimeByName("accurate"), 1).front().problem;
  for (const double sigma : {-0.1, 0.31, std::nan("")}) {
    problem.priors.focal_sigma = sigma;
    EXPECT_TRUE(FailsWithInputError(
        [&] { MakePoseEstimator(StandardOptions(Method::kP3p))->Estimate(problem); },
        {"focal length's sigma: expected a share from 0 to 0.3"}));
  }
}

// A panorama has no focal length: nothing changes.
TEST(RefineFocal, LeavesPanoramasAsTheyAre) {
  SyntheticProblem synthetic = MakeRegime(RegimeByName("accurate"), 1).front();
  PoseProblem& problem = synthetic.problem;
  const Camera pinhole = problem.query_camera;
  const double size[] = {4000, 2000};
  const Camera panorama(CameraModel::kEquirectangular, 4000, 2000, size);
  const auto project = [&](Eigen::Vector2d& px) {
    if (const auto ray = pinhole.RayInCam(px)) px = panorama.ImgFromCam(*ray).value_or(px);
  };
  for (Match2D2D& match : problem.matches_2d2d) project(match.query_px);
  for (Match2D3D& match : problem.matches_2d3d) project(match.query_px);
  problem.query_camera = panorama;
  const auto estimator = MakePoseEstimator(StandardOptions(Method::kAdaptive));
  const PoseEstimate known = estimator->Estimate(problem);
  problem.priors.focal_range = 2;
  const PoseEstimate estimate = estimator->Estimate(problem);
  ASSERT_TRUE(known.cam_from_world && estimate.cam_from_world);
  EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, *known.cam_from_world, 0, 0));
  EXPECT_EQ(estimate.covariance, known.covariance);
  EXPECT_FALSE(estimate.refined_camera);
}

// What is not known is in the covariance: the errors of many problems are as large as it says.
TEST(RefineFocal, SaysHowUncertainItLeavesThePose) {
  for (const Method method : {Method::kP3p, Method::kAdaptive}) {
    double of_refined = 0;
    double more = 0;
    const auto problems = MakeRegime(RegimeByName("accurate"), 12);
    for (const SyntheticProblem& synthetic : problems) {
      EstimatorOptions options = StandardOptions(method);
      const PoseEstimate known = MakePoseEstimator(options)->Estimate(synthetic.problem);
      options.refine_focal = true;
      const PoseEstimate estimate = MakePoseEstimator(options)->Estimate(synthetic.problem);
      ASSERT_TRUE(estimate.cam_from_world && estimate.covariance && known.covariance);
      const Eigen::Vector3d error =
          estimate.cam_from_world->OriginInSource() - synthetic.query_from_world.OriginInSource();
      of_refined += error.squaredNorm() / (estimate.position_sigma * estimate.position_sigma);
      more += std::log(estimate.position_sigma / known.position_sigma);
    }
    // Over 12 problems of some two degrees of freedom each: between a third and three.
    const auto count = static_cast<double>(problems.size());
    EXPECT_GT(of_refined / count, 1.0 / 3);
    EXPECT_LT(of_refined / count, 3);
    EXPECT_GT(more / count, 0.1);
  }
}

TEST(RefineFocal, IsOffByDefault) {
  const SyntheticProblem synthetic = MakeRegime(RegimeByName("accurate"), 1).front();
  EXPECT_FALSE(
      MakePoseEstimator(StandardOptions(Method::kP3p))->Estimate(synthetic.problem).refined_camera);
}

// The depths of the one reference are all wrong by a factor, of which the standard deviation is
// known: the covariance holds what follows from it. Said by the options or by the problem, it is
// the same; without it the position is not sure.
TEST(ReferenceSigmas, HoldAFactorThatOneReferencesDepthsAreWrongBy) {
  Rng rng = TestRng();
  constexpr int kProblems = 60;
  constexpr double kSigma = 0.08;
  double sum = 0;
  int known = 0;
  for (int i = 0; i < kProblems; ++i) {
    CoherentProblem made = MakeCoherentProblem("factor",
                                               {.num_references = 1,
                                                .vertical = 0.5,
                                                .seen = 0.9,
                                                .reference_factor = kSigma,
                                                .surface = 0.02},
                                               rng);
    EstimatorOptions options;
    EXPECT_NE(MakePoseEstimator(options)->Estimate(made.problem).verdict, PoseVerdict::kLocalized);
    options.reference_factor_sigma = kSigma;
    const PoseEstimate estimate = MakePoseEstimator(options)->Estimate(made.problem);
    // Seldom a pose explains the 2D-2D matches alone, which do not tell the position.
    if (!estimate.covariance) continue;
    ++known;
    const Eigen::Matrix<double, 6, 1> error =
        StepBetween(made.query_from_world, *estimate.cam_from_world);
    sum += error.dot(estimate.covariance->ldlt().solve(error)) / 6;
    if (i > 0) continue;
    options.reference_factor_sigma.reset();
    made.problem.reference_sigmas.factor = kSigma;
    EXPECT_EQ(MakePoseEstimator(options)->Estimate(made.problem).covariance, estimate.covariance);
  }
  EXPECT_GE(known, kProblems - 3);
  // Three standard deviations of the mean, to what calibration is asked to be.
  const double tolerance = 3 * std::sqrt(2.0 / 6 / kProblems);
  EXPECT_GT(sum / known, 0.8 - tolerance);
  EXPECT_LT(sum / known, 1.3 + tolerance);
}

TEST(ReferenceSigmas, MustBeStandardDeviations) {
  EstimatorOptions options;
  options.reference_position_sigma = -1;
  EXPECT_THROW(MakePoseEstimator(options), OptionError);
}

}  // namespace
}  // namespace raylift
