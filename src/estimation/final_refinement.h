// The final refinement of the pose that RANSAC found.

#pragma once

#include <optional>

#include "estimation/focal_step.h"
#include "estimation/joint_noise.h"
#include "estimation/keypoint_evidence.h"
#include "estimation/match_residuals.h"
#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"
#include <Eigen/Core>

#include "raylift/estimation/pose_estimator.h"

namespace raylift {

struct FinalPose {
  SolverPose pose;
  // Of the step (w, v) in the camera's tangent frame, v in local units; none where singular.
  std::optional<Eigen::Matrix<double, 6, 6>> covariance;
  // Of a refinement over both kinds of matches.
  std::optional<JointNoise> noise;
  bool references_disagree = false;
  // Where the focal length is refined.
  std::optional<FocalStep> focal = std::nullopt;
};

// kPaper: the pose as it is. kRobust: by both kinds together where both are asked for
// (joint_refinement.h), which needs the evidence; by maximum likelihood of one kind otherwise.
FinalPose RefineFinally(const PreparedProblem& problem,
                        const std::optional<KeypointEvidence>& evidence, const SolverPose& pose,
                        ResidualKinds kinds, const EstimatorOptions& options);

}  // namespace raylift
