#include "raylift/estimation/match_noise.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace raylift {
namespace {

struct Shown {
  double variance, errors;
};

KnownNoise Pool(const std::vector<Shown>& queries) {
  // The logarithm of a variance that n errors have shown varies by 2 / n; of few errors it says
  // nothing.
  constexpr double kEnoughErrors = 5;
  double weights = 0, squared_weights = 0, logs = 0;
  int count = 0;
  for (const Shown& query : queries) {
    if (query.errors < kEnoughErrors) continue;
    const double weight = 0.5 * query.errors;
    weights += weight;
    squared_weights += weight * weight;
    logs += weight * std::log(query.variance);
    ++count;
  }
  double between = 0;
  if (count >= 2) {
    const double mean = logs / weights;
    double q = 0;
    for (const Shown& query : queries) {
      if (query.errors < kEnoughErrors) continue;
      const double off = std::log(query.variance) - mean;
      q += 0.5 * query.errors * off * off;
    }
    between = std::max(0.0, (q - (count - 1)) / (weights - squared_weights / weights));
  }
  // Each query's errors, no more than what its own difference from the others leaves of them.
  double errors = 0, squares = 0;
  for (const Shown& query : queries) {
    const double weight = query.errors / (1 + 0.5 * query.errors * between);
    errors += weight;
    squares += weight * query.variance;
  }
  if (!(errors > 0)) return {};
  return {std::sqrt(squares / errors), errors / (1 + 0.5 * errors * between)};
}

}  // namespace

SceneNoise PoolNoise(std::span<const MatchNoise> queries) {
  std::vector<Shown> pixels, depths, commons;
  double tails = 0, squared_tails = 0;
  for (const MatchNoise& noise : queries) {
    pixels.push_back({noise.keypoint_px * noise.keypoint_px, noise.keypoint_errors});
    depths.push_back({noise.depth * noise.depth, noise.depth_errors});
    commons.push_back({noise.common_depth * noise.common_depth, noise.common_depth_errors});
    tails += noise.keypoint_tail;
    squared_tails += noise.keypoint_tail * noise.keypoint_tail;
  }
  SceneNoise scene{
      .keypoint_px = Pool(pixels), .depth = Pool(depths), .common_depth = Pool(commons)};
  const auto count = static_cast<double>(queries.size());
  if (count >= 2) {
    scene.keypoint_tail = tails / count;
    // As if one more query lay a tenth off.
    const double squares = std::max(0.0, squared_tails - tails * scene.keypoint_tail);
    scene.keypoint_tail_variance = (squares + 0.01) / count;
  }
  return scene;
}

}  // namespace raylift
