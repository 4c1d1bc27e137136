#include "estimation/refinement/refinement.h"

#include "estimation/refinement/single_set.h"

#include "raylift/base/error.h"

namespace raylift {
namespace {

// Takes what is known of the scene; where nothing is known of its keypoints, it is as if four
// errors had shown what is assumed before anything is seen.
NoisePrior PriorOf(const std::optional<SceneNoise>& scene, double threshold2) {
  NoisePrior prior;
  prior.keypoint_px2 = {threshold2 * kPriorVariance, 4};
  if (!scene) return prior;
  const auto variance = [](const KnownNoise& known) {
    return VariancePrior{known.sigma * known.sigma, known.errors};
  };
  if (scene->keypoint_px.errors > 4) prior.keypoint_px2 = variance(scene->keypoint_px);
  prior.depth = variance(scene->depth);
  prior.common_depth = variance(scene->common_depth);
  if (scene->keypoint_tail_variance > 0) {
    prior.keypoint_tail = TailPrior{scene->keypoint_tail, scene->keypoint_tail_variance};
  }
  return prior;
}

}  // namespace

RefinedPose KeepPose(const NormalizedProblem& problem, const CamFromLocal& pose, MatchSets sets) {
  MaximumLikelihood likelihood(problem, sets);
  likelihood.StayAt(pose);
  return {.pose = pose, .covariance = likelihood.Covariance()};
}

RefinedPose RefineByInliers(const NormalizedProblem& problem, const CamFromLocal& pose,
                            MatchSets sets) {
  MaximumLikelihood likelihood(problem, sets);
  likelihood.Refine(pose);
  return {.pose = likelihood.pose(), .covariance = likelihood.Covariance()};
}

RefinedPose RefineByEvidence(const NormalizedProblem& problem, const KeypointEvidence& evidence,
                             const CamFromLocal& pose, const std::optional<SceneNoise>& scene,
                             FocalDerivatives focal) {
  const double threshold2 = problem.sampson_threshold_px * problem.sampson_threshold_px;
  const double variance =
      problem.matches_2d2d.empty()
          ? kPriorVariance
          : NoiseVariance(ComputeResiduals(problem, pose, MatchSets::k2D2D).of_2d2d, kModel2D2D);
  return RefineJointly(evidence, pose, threshold2 * variance, PriorOf(scene, threshold2),
                       problem.priors, focal);
}

RefinedPose RefineFinally(const NormalizedProblem& problem,
                          const std::optional<KeypointEvidence>& evidence, const CamFromLocal& pose,
                          MatchSets sets, const EstimatorOptions& options) {
  if (options.refinement == Refinement::kPaper) return KeepPose(problem, pose, sets);
  if (sets != MatchSets::kBoth) return RefineByInliers(problem, pose, sets);
  RAYLIFT_CHECK(evidence.has_value());
  return RefineByEvidence(problem, *evidence, pose, options.scene_noise);
}

}  // namespace raylift
