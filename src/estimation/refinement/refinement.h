// The refinement of a pose after RANSAC: by one match set, or jointly by all evidence.
//
// Jointly, each query keypoint is one unknown point of the scene, which its pixel in the query, its
// pixels in the references, its lifted depths and unanchored 3D points all observe. With exact
// depths this is the P3P problem, without depths that of structure-less localization over several
// references, and nothing counts twice: a keypoint's noise is in all of its matches, and a depth
// that follows from a pixel adds nothing to it. The likelihood of a match is a mixture: right with
// its depth, right with a useless depth, wrong; pixels' errors follow Student's t.
//
// The depths' noise is estimated with the pose: an error of each depth by itself, one that the
// depths of a keypoint have in common (the surface is off) and, where the residuals show that
// references disagree as wholes, a scale of each reference's depths and an error of its pose.
// Variances follow MacKay's fixed point (Neural Computation 4, 1992), which takes the unknowns' own
// uncertainty into account; the points are eliminated by the Schur complement. README.md in
// src/estimation has the equations.

#pragma once

#include <optional>

#include "estimation/problem/normalized_problem.h"
#include "estimation/problem/observations.h"
#include "estimation/refinement/joint/model.h"
#include "estimation/refinement/pose_minimizer.h"

#include "raylift/estimation/options.h"

namespace raylift {

struct RefinedPose {
  CamFromLocal pose;
  // The covariance of the step (w, v) in the camera's tangent frame, v in local units; nullopt
  // where the normal equations are singular.
  std::optional<Matrix6d> covariance;
  // The noise that the joint refinement estimated; nullopt without it.
  std::optional<JointNoise> noise = std::nullopt;
  bool references_disagree = false;  // by more than is known of them
  // Log likelihood of the joint model, by which refinements of one problem with the same unknowns
  // are compared.
  double log_likelihood = 0;
  // The share by which the query's focal length seems longer than the given one, 0 where that is
  // exact; the pose is that of the longer one.
  double focal_error = 0;
  std::optional<FocalStep> focal = std::nullopt;  // where it was asked for
};

// Returns what the options, the problem and the scene say of the noise, in this order of
// precedence; nullopt if nothing.
std::optional<SceneNoise> KnownNoiseOf(const NormalizedProblem& problem,
                                       const EstimatorOptions& options);

// Tells whether to find the step of the focal length at the refined pose (RefinedPose::focal).
enum class FocalDerivatives { kNone, kAtPose };

// Tells when the joint refinement gives each reference errors of its own: where their residuals
// show some, or always.
enum class ReferenceErrors { kWhereSeen, kAlways };

// Refines a pose as the options say: kPaper leaves it as it is; kRobust refines it jointly where
// both sets are asked for, which needs the evidence, and by maximum likelihood of one set's
// inliers (single_set.h) otherwise.
RefinedPose RefineFinally(const NormalizedProblem& problem,
                          const std::optional<KeypointEvidence>& evidence, const CamFromLocal& pose,
                          MatchSets sets, const EstimatorOptions& options);

// Refines a pose jointly where each reference's depths may have any scale, which triangulation at
// the pose gives to begin with. For comparing poses that depths and 2D-2D matches disagree on: the
// log likelihood is with a prior of the scales, the normal distribution that is known of them, or
// Cauchy's as wide as the error of one depth.
RefinedPose RefineWithScales(const NormalizedProblem& problem, const KeypointEvidence& evidence,
                             const CamFromLocal& pose, const EstimatorOptions& options);

// Returns the pose as it is, with its covariance by some match sets.
RefinedPose KeepPose(const NormalizedProblem& problem, const CamFromLocal& pose, MatchSets sets);

// Refines a pose jointly; `scene` is what the scene's queries have in common.
RefinedPose RefineByEvidence(const NormalizedProblem& problem, const KeypointEvidence& evidence,
                             const CamFromLocal& pose, const std::optional<SceneNoise>& scene,
                             FocalDerivatives focal = FocalDerivatives::kNone,
                             ReferenceErrors reference_errors = ReferenceErrors::kWhereSeen);

// Refines a pose jointly, from a first guess of the keypoints' variance.
RefinedPose RefineJointly(const KeypointEvidence& evidence, const CamFromLocal& start,
                          double keypoint_variance_px2, const NoisePrior& prior,
                          const NormalizedPriors& pose_priors = {},
                          FocalDerivatives focal = FocalDerivatives::kNone,
                          ReferenceErrors reference_errors = ReferenceErrors::kWhereSeen,
                          double focal_sigma = 0);

}  // namespace raylift
