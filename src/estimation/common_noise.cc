#include "estimation/common_noise.h"

#include <vector>

#include "base/index_sets.h"

#include "raylift/base/parallel.h"
#include "raylift/estimation/pose_estimate.h"

namespace raylift {

std::optional<SceneNoise> LearnSceneNoise(size_t count,
                                          const std::function<PoseProblem(size_t)>& problem_at,
                                          const EstimatorOptions& options, int threads) {
  constexpr size_t kProblems = 30;
  if (!UsesSceneNoise(options) || count < kLeastForCommonNoise) return std::nullopt;
  const auto estimator = MakePoseEstimator(options);
  const std::vector<size_t> sample = EvenlySpaced(count, kProblems);
  std::vector<PoseEstimate> estimates(sample.size());
  ParallelFor(sample.size(), threads,
              [&](size_t i) { estimates[i] = estimator->Estimate(problem_at(sample[i])); });
  return CommonNoise(estimates);
}

}  // namespace raylift
