// Decides which localized queries may become references: those whose pose is well supported,
// certain, and the same by points as by pairs.

#pragma once

#include <optional>
#include <string>

#include "localization/continuous/joined_references.h"

#include "raylift/localization/localizer.h"

namespace raylift {

struct JoinGateOptions {
  int min_inliers_2d2d = 30;
  int min_inliers_2d3d = 20;  // where there are 2D-3D matches at all
  double max_rotation_sigma_deg = 0.5;
  // This is in scene units; with nullopt it is a share of the distance to what the query sees.
  std::optional<double> max_position_sigma = std::nullopt;
  // P3P and E5+1, each alone, must find poses that differ by no more than the limits below.
  bool needs_agreement = true;
  double max_difference_deg = 1;
  std::optional<double> max_difference_position = std::nullopt;  // as for the standard deviation

  static constexpr double kPositionSigmaShare = 0.02;
  static constexpr double kDifferenceShare = 0.05;

  // Throws OptionError for a value out of its range.
  void Validate() const;
};

// The poses of both solvers, each alone.
struct SolverPoses {
  std::optional<Rigid3> p3p_cam_from_world;
  std::optional<Rigid3> e5p1_cam_from_world;
};
SolverPoses EstimateBySolvers(const PoseProblem& problem, const EstimatorOptions& options,
                              int threads);

// Evidence that a localized query has to show.
struct JoinEvidence {
  PoseVerdict verdict = PoseVerdict::kLocalized;
  int inliers_2d2d = 0;
  std::optional<int> inliers_2d3d;  // nullopt: there were no 2D-3D matches
  double distance = 0;              // see JoinedReference
  // The covariance of the pose, with the errors of other joined references and half of the solvers'
  // difference; nullopt where the inliers do not determine the pose.
  std::optional<PoseCovariance> covariance;
  double rotation_sigma_deg = 0;
  double position_sigma = 0;
  // Both solvers were run. The differences are known where both found a pose.
  bool asked_solvers = false;
  std::optional<double> difference_deg;
  std::optional<double> difference_position;
};

// Collects the evidence. `solvers` is nullopt where not both were run, as for a query without 2D-3D
// matches.
JoinEvidence CollectEvidence(const QueryResult& result, const JoinedReferences& joined,
                             const std::optional<SolverPoses>& solvers);

// Returns why a query may not join; empty where it may.
std::string ReasonNotToJoin(const JoinEvidence& evidence, const JoinGateOptions& options);

}  // namespace raylift
