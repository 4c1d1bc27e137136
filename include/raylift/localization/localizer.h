// One query in, one pose out: matches are lifted, made a pose problem and estimated. The counts of
// every stage come out with the pose, so that a failure explains itself.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/estimation/pose_estimator.h"
#include "raylift/io/query_list.h"
#include "raylift/lifting/candidates.h"
#include "raylift/lifting/consistency_filter.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/lifting/lifter.h"
#include "raylift/localization/match_source.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct StageCounts {
  size_t retrieved = 0;  // references
  size_t matched = 0;    // 2D-2D matches
  size_t hit = 0;        // of those, lifted to the scene
  // The 3D points that each source of geometry gave; their sum is `hit` unless all are asked.
  std::vector<size_t> points_of_source;
  FilterCounts filter;                  // of the points, kept and dropped by the filter
  std::optional<MultiViewNoise> noise;  // as the automatic filter found it
  size_t points = 0;                    // 2D-3D matches that were estimated from
  size_t inliers_2d3d = 0;
  size_t inliers_2d2d = 0;
};

struct LocalizedQuery {
  std::string name;
  std::string reason;  // why there is no pose; empty where there is one
  StageCounts counts;
  PoseEstimate estimate;
  double match_ms = 0;
  double lift_ms = 0;
  double estimate_ms = 0;
  std::optional<int> rerender_rounds;  // that were kept; none where it was not asked for
  double rerender_ms = 0;

  // Localized: the whole pose is known.
  bool localized() const { return reason.empty(); }
  // Also counts its inliers.
  void TakeEstimate(PoseEstimate taken);
};

// Why an estimate is no localization; empty where it is one.
std::string ReasonNotLocalized(const PoseEstimate& estimate);

struct QueryResult {
  LocalizedQuery localized;
  PoseProblem problem;  // what was estimated
};

// What a query is localized with.
struct LocalizerParts {
  const MatchSource& match_source;
  const Covisibility& covisibility;
  std::span<const GeometrySource* const> geometry;  // none: nothing is lifted
  GeometryMode geometry_mode = GeometryMode::kFirst;
  const FilterOptions& filter;
  CandidateOptions candidates = {};  // merged are those that the filter keeps
  const PoseEstimator& estimator;
};
// How noisy the geometry is in the views of some 30 queries, the same ones whatever their order,
// for the automatic filter (FilterOptions::scene_noise). None where no query tells.
std::optional<MultiViewNoise> EstimateSceneNoise(std::span<const Query> queries,
                                                 const LocalizerParts& parts, int threads);
QueryResult LocalizeQuery(const Query& query, const LocalizerParts& parts);

}  // namespace raylift
