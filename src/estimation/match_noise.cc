#include "raylift/estimation/match_noise.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/index_sets.h"
#include "estimation/fields.h"

#include "raylift/base/parallel.h"
#include "raylift/estimation/pose_estimator.h"

namespace raylift {
namespace {

// Fewer errors tell neither their variance nor how it varies.
constexpr double kEnoughErrors = 5;
constexpr int kEnoughQueries = 3;

struct Shown {
  double variance, errors;
};

KnownNoise Pool(const std::vector<Shown>& queries) {
  // The logarithm of a variance that n errors have shown has the variance 2 / n.
  double weights = 0, squared_weights = 0, logs = 0;
  int count = 0;
  for (const Shown& query : queries) {
    if (!(query.errors >= kEnoughErrors && query.variance > 0)) continue;
    const double weight = 0.5 * query.errors;
    weights += weight;
    squared_weights += weight * weight;
    logs += weight * std::log(query.variance);
    ++count;
  }
  if (count < kEnoughQueries) return {};
  const double mean = logs / weights;
  double q = 0;
  for (const Shown& query : queries) {
    if (!(query.errors >= kEnoughErrors && query.variance > 0)) continue;
    const double off = std::log(query.variance) - mean;
    q += 0.5 * query.errors * off * off;
  }
  const double between = std::max(0.0, (q - (count - 1)) / (weights - squared_weights / weights));
  // The variances are averaged, not their logarithms, of which few errors tell little. A query's n
  // errors count as n / (1 + n between / 2), as its variance differs from the others'.
  double errors = 0, squares = 0;
  for (const Shown& query : queries) {
    if (!(query.errors >= 1)) continue;
    const double weight = query.errors / (1 + 0.5 * query.errors * between);
    errors += weight;
    squares += weight * query.variance;
  }
  return {std::sqrt(squares / errors), errors / (1 + 0.5 * errors * between)};
}

}  // namespace

SceneNoise PoolNoise(std::span<const MatchNoise> queries) {
  // The tail of a query with fewer errors is little more than its prior.
  constexpr double kFewestErrorsOfTail = 30;
  std::vector<Shown> pixels, depths, commons;
  std::vector<double> tails;
  for (const MatchNoise& noise : queries) {
    // The scale of Student's t is known less well than that of a normal distribution.
    pixels.push_back({noise.keypoint_px * noise.keypoint_px,
                      noise.keypoint_errors / (1 + 4 * noise.keypoint_tail)});
    depths.push_back({noise.depth * noise.depth, noise.depth_errors});
    commons.push_back({noise.common_depth * noise.common_depth, noise.common_depth_errors});
    if (noise.keypoint_errors >= kFewestErrorsOfTail) tails.push_back(noise.keypoint_tail);
  }
  SceneNoise scene;
  scene.keypoint_px = Pool(pixels);
  scene.depth = Pool(depths);
  scene.common_depth = Pool(commons);
  if (tails.size() >= kEnoughQueries) {
    const auto count = static_cast<double>(tails.size());
    for (const double tail : tails) scene.keypoint_tail += tail / count;
    // One more deviation, of a tenth, keeps the variance from being 0.
    double squares = 0.01;
    for (const double tail : tails) {
      squares += (tail - scene.keypoint_tail) * (tail - scene.keypoint_tail);
    }
    scene.keypoint_tail_variance = squares / count;
  }
  return scene;
}

std::optional<SceneNoise> CommonNoise(std::span<const PoseEstimate> estimates) {
  std::vector<MatchNoise> noise;
  for (const PoseEstimate& estimate : estimates) {
    if (estimate.verdict == PoseVerdict::kLocalized && estimate.noise) {
      noise.push_back(*estimate.noise);
    }
  }
  if (noise.size() < kLeastForCommonNoise) return std::nullopt;
  return PoolNoise(noise);
}

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

std::vector<Field> FieldsOf(MatchNoise& noise) {
  return {
      {"keypoint_px", noise.keypoint_px},
      {"keypoint_tail", noise.keypoint_tail},
      {"depth", noise.depth},
      {"common_depth", noise.common_depth},
      {"reference_factor", noise.reference_factor},
      {"reference_rotation_deg", noise.reference_rotation_deg},
      {"reference_position", noise.reference_position},
  };
}

}  // namespace raylift
