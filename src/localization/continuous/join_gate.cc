#include "localization/continuous/join_gate.h"

#include <array>
#include <cmath>
#include <string_view>

#include "base/constants.h"
#include "geometry/pose_step.h"
#include "localization/fields.h"
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/geometry/residuals.h"

namespace raylift {

void JoinGateOptions::Validate() const { CheckRanges(ConstFieldsOf(*this)); }

SolverPoses EstimateBySolvers(const PoseProblem& problem, const EstimatorOptions& options,
                              int threads) {
  constexpr std::array kMethods = {Method::kP3p, Method::kE5p1};
  std::array<std::optional<Rigid3>, kMethods.size()> poses;
  ParallelFor(kMethods.size(), threads, [&](size_t i) {
    EstimatorOptions alone = options;
    alone.method = kMethods[i];
    const PoseEstimate estimate = MakePoseEstimator(alone)->Estimate(problem);
    if (estimate.position_observable) poses[i] = estimate.cam_from_world;
  });
  return {poses[0], poses[1]};
}

JoinEvidence CollectEvidence(const QueryResult& result, const JoinedReferences& joined,
                             const std::optional<SolverPoses>& solvers) {
  const PoseEstimate& estimate = result.localized.estimate;
  JoinEvidence evidence;
  evidence.verdict = result.localized.verdict();
  evidence.inliers_2d2d = estimate.score_2d2d.num_inliers;
  if (!result.problem.matches_2d3d.empty()) {
    evidence.inliers_2d3d = estimate.score_2d3d.num_inliers;
  }
  evidence.distance = SceneDistance(result);
  if (estimate.covariance) evidence.covariance = *estimate.covariance + joined.PassedOn(result);
  evidence.asked_solvers = solvers.has_value();
  if (solvers && solvers->p3p_cam_from_world && solvers->e5p1_cam_from_world) {
    const Rigid3& p3p = *solvers->p3p_cam_from_world;
    const Rigid3& e5p1 = *solvers->e5p1_cam_from_world;
    evidence.difference_deg = AngleBetweenDeg(p3p.rotation, e5p1.rotation);
    evidence.difference_position = (p3p.OriginInSource() - e5p1.OriginInSource()).norm();
    // Two estimates that hardly share their errors: their mean is off by half of their difference.
    const Vector6d half = 0.5 * StepBetween(p3p, e5p1);
    if (evidence.covariance) *evidence.covariance += half * half.transpose();
  }
  if (evidence.covariance) {
    evidence.rotation_sigma_deg =
        std::sqrt(evidence.covariance->topLeftCorner<3, 3>().trace()) * kDegPerRad;
    evidence.position_sigma = std::sqrt(evidence.covariance->bottomRightCorner<3, 3>().trace());
  }
  return evidence;
}

std::string ReasonNotToJoin(const JoinEvidence& evidence, const JoinGateOptions& options) {
  if (evidence.verdict != PoseVerdict::kLocalized) return "its pose is in doubt";
  if (evidence.inliers_2d2d < options.min_inliers_2d2d) {
    return fmt::format("{} 2D-2D inliers, {} are needed", evidence.inliers_2d2d,
                       options.min_inliers_2d2d);
  }
  if (evidence.inliers_2d3d && *evidence.inliers_2d3d < options.min_inliers_2d3d) {
    return fmt::format("{} 2D-3D inliers, {} are needed", *evidence.inliers_2d3d,
                       options.min_inliers_2d3d);
  }
  if (!evidence.covariance) return "its covariance is not known";
  const auto limit = [&evidence](const std::optional<double>& given, double share) {
    return given.value_or(share * evidence.distance);
  };
  if (options.needs_agreement && evidence.asked_solvers) {
    if (!evidence.difference_deg) return "P3P or E5+1 alone finds no pose";
    if (!(*evidence.difference_deg <= options.max_difference_deg)) {
      return fmt::format("P3P and E5+1 differ by {:.3g} degrees, {:.3g} are allowed",
                         *evidence.difference_deg, options.max_difference_deg);
    }
    const double most = limit(options.max_difference_position, JoinGateOptions::kDifferenceShare);
    if (!(*evidence.difference_position <= most)) {
      return fmt::format("the positions by P3P and E5+1 differ by {:.3g}, {:.3g} is allowed",
                         *evidence.difference_position, most);
    }
  }
  if (!(evidence.rotation_sigma_deg <= options.max_rotation_sigma_deg)) {
    return fmt::format("the rotation's standard deviation is {:.3g} degrees, {:.3g} are allowed",
                       evidence.rotation_sigma_deg, options.max_rotation_sigma_deg);
  }
  const double most = limit(options.max_position_sigma, JoinGateOptions::kPositionSigmaShare);
  if (!(evidence.position_sigma <= most)) {
    return fmt::format("the position's standard deviation is {:.3g}, {:.3g} is allowed",
                       evidence.position_sigma, most);
  }
  return {};
}

}  // namespace raylift
