// Whole estimators by regime: one iteration is one pass over the regime's problems. The counters
// are over the problems: the median time of one, the median errors and how many are solved (within
// 0.1 m and 1 degree).

#include <algorithm>
#include <chrono>
#include <string>
#include <vector>

#include "base/statistics.h"
#include "support/synthetic_problem.h"
#include <benchmark/benchmark.h>

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"

namespace raylift {
namespace {

struct Tally {
  std::vector<double> ms, rotation_deg, position, iterations;
  int solved = 0;

  void Add(const PoseEstimate& estimate, const Rigid3& truth, double milliseconds) {
    ms.push_back(milliseconds);
    iterations.push_back(estimate.iterations);
    const bool found = estimate.cam_from_world.has_value();
    const Rigid3 pose = estimate.cam_from_world.value_or(Rigid3{});
    rotation_deg.push_back(found ? AngleBetweenDeg(pose.rotation, truth.rotation) : 180);
    position.push_back(found ? (pose.OriginInSource() - truth.OriginInSource()).norm() : 1e9);
    solved += rotation_deg.back() < 1 && position.back() < 0.1 ? 1 : 0;
  }
};

void RunRegime(benchmark::State& state, const EstimatorOptions& options,
               const SyntheticRegime& regime) {
  const auto problems = MakeRegime(regime, regime.num_problems);
  const auto estimator = MakePoseEstimator(options);
  Tally tally;
  for (auto _ : state) {
    for (const SyntheticProblem& made : problems) {
      const auto start = std::chrono::steady_clock::now();
      const PoseEstimate estimate = estimator->Estimate(made.problem);
      const std::chrono::duration<double, std::milli> taken =
          std::chrono::steady_clock::now() - start;
      tally.Add(estimate, made.query_from_world, taken.count());
    }
  }
  state.counters["ms"] = UpperMedianOr(tally.ms, 0);
  state.counters["rot_deg"] = UpperMedianOr(tally.rotation_deg, 0);
  state.counters["pos_mm"] = 1000 * UpperMedianOr(tally.position, 0);
  state.counters["iterations"] = UpperMedianOr(tally.iterations, 0);
  state.counters["solved_%"] = 100.0 * tally.solved / static_cast<double>(tally.ms.size());
}

struct Variant {
  const char* name;
  Method method;
  ScoreCombination score = ScoreCombination::kSumMsac;
  LocalOptimization local_optimization = LocalOptimization::kHybrid;
};

const bool kRegistered = [] {
  using enum Method;
  using enum ScoreCombination;
  using enum LocalOptimization;
  const Variant variants[] = {{"p3p", kP3p},
                              {"e5p1", kE5p1},
                              {"adaptive", kAdaptive},
                              {"adaptive_mult_msac", kAdaptive, kMultMsac},
                              {"adaptive_split", kAdaptive, kSumMsac, kSplit},
                              {"select", kSelect}};
  for (const SyntheticRegime& regime : AllRegimes()) {
    for (const Variant& variant : variants) {
      EstimatorOptions options;
      options.method = variant.method;
      options.score = variant.score;
      options.local_optimization = variant.local_optimization;
      options.reprojection_threshold_px = 4;
      options.sampson_threshold_px = 2;
      const std::string name = std::string(regime.name) + "/" + variant.name;
      benchmark::RegisterBenchmark(
          name.c_str(),
          [options, &regime](benchmark::State& state) { RunRegime(state, options, regime); })
          ->Unit(benchmark::kMillisecond)
          ->Iterations(3);
    }
  }
  return true;
}();

}  // namespace
}  // namespace raylift
