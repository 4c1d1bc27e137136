#include "raylift/localization/localizer.h"

#include <chrono>

#include "raylift/base/parallel.h"
#include "raylift/localization/scene_matches.h"

namespace raylift {
namespace {

class Stopwatch {
 public:
  // Milliseconds since the last call.
  double Lap() {
    const auto now = std::chrono::steady_clock::now();
    const std::chrono::duration<double, std::milli> elapsed = now - last_;
    last_ = now;
    return elapsed.count();
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

void LiftOrTriangulate(const LocalizerParts& parts, PoseProblem& problem, StageCounts& counts) {
  if (parts.candidates.mode == CandidateMode::kTriangulate) {
    problem.matches_2d3d =
        TriangulateMatches(problem.references, problem.matches_2d2d, parts.candidates);
    return;
  }
  const LiftResult lifted =
      LiftMatches(parts.geometry, parts.geometry_mode, problem.references, problem.matches_2d2d);
  problem.matches_2d3d = Matches2D3D(lifted);
  counts.hit = lifted.counts.hits;
  counts.points_of_source = lifted.counts.points_of_source;
}

// The filter judges each candidate by itself, so that bad ones do not come into the merged point.
void MakePoints(const LocalizerParts& parts, PoseProblem& problem, StageCounts& counts) {
  LiftOrTriangulate(parts, problem, counts);
  const FilterResult filtered = FilterProblem(parts.filter, problem);
  counts.filter = filtered.counts;
  counts.noise = filtered.noise;
  if (parts.candidates.mode == CandidateMode::kMerge) {
    problem.matches_2d3d = MergeCandidates(problem.references, problem.matches_2d2d,
                                           problem.matches_2d3d, parts.candidates);
  }
  counts.points = problem.matches_2d3d.size();
}

}  // namespace

void LocalizedQuery::TakeEstimate(PoseEstimate taken) {
  estimate = std::move(taken);
  counts.inliers_2d3d = static_cast<size_t>(estimate.score_2d3d.num_inliers);
  counts.inliers_2d2d = static_cast<size_t>(estimate.score_2d2d.num_inliers);
}

std::string ReasonNotLocalized(const PoseEstimate& estimate) {
  if (!estimate.cam_from_world) {
    return std::string(ToString(estimate.failure));
  }
  if (!estimate.position_observable) {
    return "only the orientation is known: all references with matches share one centre";
  }
  return {};
}

std::optional<MultiViewNoise> EstimateSceneNoise(std::span<const Query> queries,
                                                 const LocalizerParts& parts, int threads) {
  constexpr size_t kQueries = 30;
  const std::vector<size_t> sample = SampleByName(queries, kQueries);
  std::vector<std::optional<MultiViewNoise>> found(sample.size());
  ParallelFor(sample.size(), threads, [&](size_t i) {
    const QueryMatches matches = parts.match_source.Match(queries[sample[i]]);
    const LiftResult lifted =
        LiftMatches(parts.geometry, parts.geometry_mode, matches.references, matches.matches);
    const auto trust = EstimateTrust(matches.references, matches.matches, Matches2D3D(lifted));
    if (trust) found[i] = trust->noise;
  });
  std::vector<MultiViewNoise> noise;
  for (const auto& of_query : found) {
    if (of_query) noise.push_back(*of_query);
  }
  return PooledNoise(noise);
}

QueryResult LocalizeQuery(const Query& query, const LocalizerParts& parts) {
  QueryResult result;
  LocalizedQuery& localized = result.localized;
  PoseProblem& problem = result.problem;
  localized.name = problem.name = query.name;
  problem.query_camera = query.camera;

  Stopwatch stopwatch;
  QueryMatches matches = parts.match_source.Match(query);
  problem.references = std::move(matches.references);
  problem.reference_clusters = parts.covisibility.Clusters(problem.references);
  problem.matches_2d2d = std::move(matches.matches);
  localized.counts.retrieved = problem.references.size();
  localized.counts.matched = problem.matches_2d2d.size();
  localized.match_ms = stopwatch.Lap();

  MakePoints(parts, problem, localized.counts);
  localized.lift_ms = stopwatch.Lap();

  localized.TakeEstimate(parts.estimator.Estimate(problem));
  localized.estimate_ms = stopwatch.Lap();
  if (localized.counts.retrieved == 0) {
    localized.reason = "no retrieved references";
  } else if (localized.counts.matched == 0) {
    localized.reason = "no matches with the retrieved references";
  } else {
    localized.reason = ReasonNotLocalized(localized.estimate);
  }
  return result;
}

}  // namespace raylift
