// The refinement of a pose by all evidence at once: each query keypoint is one unknown point of the
// scene, which its pixel in the query, its pixels in the references, its lifted depths and loose 3D
// points all observe. With exact depths this is the P3P problem, without depths that of
// structure-less localization over several views, and nothing counts twice: a keypoint's noise is
// in all of its matches, and a depth that follows from a pixel adds nothing to it.
//
// The likelihood of a match is a mixture: right with its depth, right with a useless depth, wrong;
// pixels' errors follow Student's t (student_t.h).
// What the depths are worth is estimated with the pose: an error of each depth by itself, one that
// the depths of a keypoint have in common (the surface is off) and, where the residuals show that
// references disagree as wholes, a factor of each reference's depths and an error of its pose.
// Variances follow MacKay's fixed point (Neural Computation 4, 1992), which takes the unknowns'
// own uncertainty into account; the points are eliminated by the Schur complement.

#pragma once

#include <optional>

#include "estimation/focal_step.h"
#include "estimation/joint_noise.h"
#include "estimation/keypoint_evidence.h"
#include "estimation/keypoint_weighing.h"
#include "estimation/prepared_priors.h"
#include "estimation/solvers/p3p.h"
#include <Eigen/Core>

namespace raylift {

struct JointResult {
  SolverPose pose;
  JointNoise noise;
  // Of the step (w, v) in the camera's tangent frame, local units; none where singular.
  std::optional<Eigen::Matrix<double, 6, 6>> covariance;
  bool references_disagree = false;
  std::optional<FocalStep> focal;  // where it is asked for
};

// `keypoint_variance_px2` is a first guess.
JointResult RefineJointly(const KeypointEvidence& evidence, const SolverPose& start,
                          double keypoint_variance_px2, const NoisePrior& prior,
                          const PreparedPriors& pose_priors = {}, bool step_of_focal = false);

}  // namespace raylift
