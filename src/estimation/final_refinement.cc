#include "estimation/final_refinement.h"

#include "estimation/joint_refinement.h"
#include "estimation/keypoint_evidence.h"
#include "estimation/maximum_likelihood.h"
#include "estimation/noise_variance.h"

namespace raylift {
namespace {

FinalPose RefineByBoth(const PoseProblem& original, const PreparedProblem& problem,
                       const SolverPose& pose) {
  constexpr ResidualKinds kPairs{.points = false, .pairs = true};
  const double threshold2 = problem.sampson_threshold_px * problem.sampson_threshold_px;
  const double variance =
      problem.pairs.empty()
          ? kPriorVariance
          : NoiseVariance(ComputeResiduals(problem, pose, kPairs).pairs, kPairNoise);
  // As if four pixels had shown what is assumed before anything is seen.
  NoisePrior prior;
  prior.keypoint_px2 = {threshold2 * kPriorVariance, 4};
  const JointResult result =
      RefineJointly(GatherEvidence(original, problem), pose, threshold2 * variance, prior);
  return {.pose = result.pose,
          .covariance = result.covariance,
          .noise = result.noise,
          .references_disagree = result.references_disagree};
}

}  // namespace

FinalPose RefineFinally(const PoseProblem& original, const PreparedProblem& problem,
                        const SolverPose& pose, ResidualKinds kinds, Refinement refinement) {
  if (refinement == Refinement::kRobust && kinds.points && kinds.pairs) {
    return RefineByBoth(original, problem, pose);
  }
  MaximumLikelihood likelihood(problem, kinds);
  if (refinement == Refinement::kRobust) {
    likelihood.Refine(pose);
  } else {
    likelihood.StayAt(pose);
  }
  return {.pose = likelihood.pose(), .covariance = likelihood.Covariance(), .noise = std::nullopt};
}

}  // namespace raylift
