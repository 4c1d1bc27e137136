#include "estimation/standard_options.h"

#include <cmath>
#include <string>

#include "estimation/fields.h"

#include "raylift/estimation/pose_estimator.h"

namespace raylift {

EstimatorOptions StandardOptions(Method method) {
  EstimatorOptions options;
  options.method = method;
  options.reprojection_threshold_px = 4;
  options.sampson_threshold_px = 2;
  options.min_iterations = 100;
  options.max_iterations = 10000;
  options.confidence = 0.9999;
  return options;
}

PoseEstimate EstimateWith(const EstimatorOptions& options, const PoseProblem& problem) {
  return MakePoseEstimator(options)->Estimate(problem);
}

PoseEstimate EstimateWith(Method method, const PoseProblem& problem) {
  return EstimateWith(StandardOptions(method), problem);
}

double PositionError(const PoseEstimate& estimate, const Rigid3& truth) {
  return (estimate.cam_from_world.value().OriginInSource() - truth.OriginInSource()).norm();
}

double PositionErrorOrFar(const PoseEstimate& estimate, const Rigid3& truth) {
  return estimate.cam_from_world ? PositionError(estimate, truth) : 1e3;
}

::testing::AssertionResult IsSound(const PoseEstimate& estimate, const PoseProblem& problem) {
  const auto fail = [](const char* what) { return ::testing::AssertionFailure() << what; };
  if (estimate.inliers_2d3d.size() != problem.matches_2d3d.size() ||
      estimate.inliers_2d2d.size() != problem.matches_2d2d.size()) {
    return fail("inlier flags do not fit the matches");
  }
  if (estimate.cam_from_world.has_value() != (estimate.failure == FailureReason::kNone)) {
    return fail("neither a pose nor a reason, or both");
  }
  if (estimate.cam_from_world && !estimate.cam_from_world->IsFinite()) {
    return fail("the pose is not finite");
  }
  if (estimate.cam_from_world && std::abs(estimate.cam_from_world->rotation.norm() - 1) > 1e-12) {
    return fail("the rotation is not of unit norm");
  }
  if (estimate.covariance && !estimate.covariance->allFinite()) {
    return fail("the covariance is not finite");
  }
  if (!std::isfinite(estimate.rotation_sigma_deg) || !std::isfinite(estimate.position_sigma) ||
      !std::isfinite(estimate.score_2d3d.msac_cost) ||
      !std::isfinite(estimate.score_2d2d.msac_cost)) {
    return fail("a number is not finite");
  }
  if (!(estimate.confidence >= 0 && estimate.confidence <= 1))
    return fail("the confidence is none");
  bool has_noise = true;
  if (estimate.noise) {
    ForEachNumber<double>(ConstFieldsOf(*estimate.noise), [&](const std::string&, double value) {
      has_noise = has_noise && std::isfinite(value);
    });
  }
  return has_noise ? ::testing::AssertionSuccess() : fail("the noise is not finite");
}

::testing::AssertionResult IsIdentical(const PoseEstimate& a, const PoseEstimate& b) {
  const auto fail = [](const char* what) { return ::testing::AssertionFailure() << what; };
  if (a.failure != b.failure || a.cam_from_world.has_value() != b.cam_from_world.has_value()) {
    return fail("one has a pose, or another reason");
  }
  if (a.cam_from_world &&
      (a.cam_from_world->rotation.coeffs() != b.cam_from_world->rotation.coeffs() ||
       a.cam_from_world->translation != b.cam_from_world->translation)) {
    return fail("the poses differ");
  }
  const auto same_score = [](const MatchSetScore& x, const MatchSetScore& y) {
    return x.num_matches == y.num_matches && x.num_inliers == y.num_inliers &&
           x.msac_cost == y.msac_cost;
  };
  if (!same_score(a.score_2d3d, b.score_2d3d) || !same_score(a.score_2d2d, b.score_2d2d)) {
    return fail("the scores differ");
  }
  if (a.inliers_2d3d != b.inliers_2d3d || a.inliers_2d2d != b.inliers_2d2d) {
    return fail("the inliers differ");
  }
  if (a.solver != b.solver || a.iterations != b.iterations) {
    return fail("solvers or iterations differ");
  }
  if (a.covariance != b.covariance || a.position_sigma != b.position_sigma) {
    return fail("the covariances differ");
  }
  return ::testing::AssertionSuccess();
}

}  // namespace raylift
