// Scoring, normal equations and local optimization: time per match (items per second, inverted by
// Google Benchmark's counter `per_match`), on every SIMD level that the processor has. Scores are
// taken in full, without early exit.

#include <vector>

#include "estimation/kernels/kernel_table.h"
#include "estimation/problem/normalized_problem.h"
#include "estimation/ransac/local_optimization.h"
#include "estimation/ransac/scores.h"
#include "estimation/refinement/refinement.h"
#include "support/synthetic_problem.h"
#include <benchmark/benchmark.h>

namespace raylift {
namespace {

struct ScoringProblem {
  SyntheticProblem synthetic;
  NormalizedProblem prepared;
  CamFromLocal truth;

  ScoringProblem(SyntheticProblem problem, Rng& rng)
      : synthetic(std::move(problem)),
        prepared(synthetic.problem, 4, 2, rng),
        truth(prepared.ToLocal(synthetic.query_from_world)) {}
};

ScoringProblem MakeScoringProblem(int num_matches) {
  SyntheticOptions options;
  options.num_2d3d = num_matches;
  options.num_2d2d = num_matches;
  options.num_references = num_matches >= 500 ? 20 : 2;
  Rng rng(1);
  SyntheticProblem problem = MakeSyntheticProblem("scoring", options, rng);
  return ScoringProblem(std::move(problem), rng);
}

void SetPerMatch(benchmark::State& state, int num_matches) {
  state.counters["per_match"] = benchmark::Counter(
      num_matches, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

// Skips levels that this processor lacks.
const kernels::KernelTable* TableOf(benchmark::State& state) {
  const auto level = static_cast<SimdLevel>(state.range(0));
  state.SetLabel(std::string(ToString(level)));
  if (IsSupported(level)) return &kernels::KernelsOf(level);
  state.SkipWithError("not on this processor");
  return nullptr;
}

void Score2D3D(benchmark::State& state) {
  const kernels::KernelTable* table = TableOf(state);
  if (table == nullptr) return;
  const int count = static_cast<int>(state.range(1));
  const ScoringProblem problem = MakeScoringProblem(count);
  const auto pose = ToKernelPose<float>(problem.truth);
  const auto& blocks = problem.prepared.blocks_2d3d;
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        table->score_2d3d(blocks.data(), static_cast<int>(blocks.size()), pose));
  }
  SetPerMatch(state, count);
}

void Score2D2D(benchmark::State& state) {
  const kernels::KernelTable* table = TableOf(state);
  if (table == nullptr) return;
  const int count = static_cast<int>(state.range(1));
  const ScoringProblem problem = MakeScoringProblem(count);
  const auto pose = ToKernelPose<float>(problem.truth);
  const auto centers = CentersInCam<float>(problem.prepared, problem.truth);
  const auto& blocks = problem.prepared.blocks_2d2d;
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        table->score_2d2d(blocks.data(), problem.prepared.block_camera_reference_2d2d.data(),
                          static_cast<int>(blocks.size()), pose, centers.data()));
  }
  SetPerMatch(state, count);
}

void Normals2D3D(benchmark::State& state) {
  const kernels::KernelTable* table = TableOf(state);
  if (table == nullptr) return;
  const int count = static_cast<int>(state.range(1));
  const ScoringProblem problem = MakeScoringProblem(count);
  const auto pose = ToKernelPose<float>(problem.truth);
  const auto& blocks = problem.prepared.blocks_2d3d;
  for (auto _ : state) {
    benchmark::DoNotOptimize(table->normals_2d3d_float(
        blocks.data(), static_cast<int>(blocks.size()), pose, kernels::KernelLoss{}));
  }
  SetPerMatch(state, count);
}

void Normals2D2D(benchmark::State& state) {
  const kernels::KernelTable* table = TableOf(state);
  if (table == nullptr) return;
  const int count = static_cast<int>(state.range(1));
  const ScoringProblem problem = MakeScoringProblem(count);
  const auto pose = ToKernelPose<float>(problem.truth);
  const auto centers = CentersInCam<float>(problem.prepared, problem.truth);
  const auto& blocks = problem.prepared.blocks_2d2d;
  for (auto _ : state) {
    benchmark::DoNotOptimize(table->normals_2d2d_float(
        blocks.data(), problem.prepared.block_camera_reference_2d2d.data(),
        static_cast<int>(blocks.size()), pose, centers.data(), kernels::KernelLoss{}));
  }
  SetPerMatch(state, count);
}

void EveryLevel(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"level", "matches"});
  for (const auto level : {SimdLevel::kSse2, SimdLevel::kAvx2, SimdLevel::kAvx512}) {
    for (const int count : {100, 1000}) benchmark->Args({static_cast<int>(level), count});
  }
}
BENCHMARK(Score2D3D)->Apply(EveryLevel);
BENCHMARK(Score2D2D)->Apply(EveryLevel);
BENCHMARK(Normals2D3D)->Apply(EveryLevel);
BENCHMARK(Normals2D2D)->Apply(EveryLevel);

void LocalOptimizationHybrid(benchmark::State& state) {
  const ScoringProblem problem = MakeScoringProblem(static_cast<int>(state.range(0)));
  CamFromLocal start = problem.truth;
  start.translation.x() += 0.01;
  for (auto _ : state) {
    benchmark::DoNotOptimize(OptimizeLocally(problem.prepared, start, MatchSets::kBoth, 6));
  }
}
BENCHMARK(LocalOptimizationHybrid)->Arg(100)->Arg(1000)->Unit(benchmark::kMicrosecond);

void FinalRefinement(benchmark::State& state) {
  const ScoringProblem problem = MakeScoringProblem(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        RefineFinally(problem.prepared, GatherEvidence(problem.synthetic.problem, problem.prepared),
                      problem.truth, MatchSets::kBoth, {}));
  }
}
BENCHMARK(FinalRefinement)->Arg(100)->Arg(1000)->Unit(benchmark::kMicrosecond);

void Preparation(benchmark::State& state) {
  const ScoringProblem problem = MakeScoringProblem(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    Rng rng(1);
    benchmark::DoNotOptimize(NormalizedProblem(problem.synthetic.problem, 4, 2, rng));
  }
}
BENCHMARK(Preparation)->Arg(100)->Arg(1000)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace raylift
