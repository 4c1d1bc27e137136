#include "estimation/final_refinement.h"

#include "estimation/joint_refinement.h"
#include "estimation/maximum_likelihood.h"
#include "estimation/noise_variance.h"

#include "raylift/base/error.h"

namespace raylift {
namespace {

// What the scene tells; of keypoints, where it tells nothing, as if four errors had shown what is
// assumed before anything is seen.
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

FinalPose RefineByBoth(const PreparedProblem& problem, const KeypointEvidence& evidence,
                       const SolverPose& pose, const EstimatorOptions& options) {
  constexpr ResidualKinds kPairs{.points = false, .pairs = true};
  const double threshold2 = problem.sampson_threshold_px * problem.sampson_threshold_px;
  const double variance =
      problem.pairs.empty()
          ? kPriorVariance
          : NoiseVariance(ComputeResiduals(problem, pose, kPairs).pairs, kPairNoise);
  const NoisePrior prior = PriorOf(options.scene_noise, threshold2);
  const JointResult result = RefineJointly(evidence, pose, threshold2 * variance, prior,
                                           problem.priors, options.refine_focal);
  return {.pose = result.pose,
          .covariance = result.covariance,
          .noise = result.noise,
          .references_disagree = result.references_disagree,
          .focal = result.focal};
}

}  // namespace

FinalPose RefineFinally(const PreparedProblem& problem,
                        const std::optional<KeypointEvidence>& evidence, const SolverPose& pose,
                        ResidualKinds kinds, const EstimatorOptions& options) {
  if (options.refinement == Refinement::kRobust && kinds.points && kinds.pairs) {
    RAYLIFT_CHECK(evidence.has_value());
    return RefineByBoth(problem, *evidence, pose, options);
  }
  MaximumLikelihood likelihood(problem, kinds);
  if (options.refinement == Refinement::kRobust) {
    likelihood.Refine(pose);
  } else {
    likelihood.StayAt(pose);
  }
  return {.pose = likelihood.pose(), .covariance = likelihood.Covariance(), .noise = std::nullopt};
}

}  // namespace raylift
