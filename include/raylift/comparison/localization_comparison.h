// The result of one method for one query, with what explains it.

#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/evaluation/pose_errors.h"
#include "raylift/lifting/consistency_filter.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/lifter.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct QueryDetail {
  size_t retrieved = 0, matched = 0, hit = 0, consistent = 0;
  size_t inliers_2d3d = 0, inliers_2d2d = 0;
  std::string solver;  // that the pose comes from; empty without a pose
  std::optional<Rigid3> cam_from_world;
  // The poses of P3P and E5+1 that Select chooses from.
  struct Candidate {
    std::string solver;
    PoseError error;
    size_t inliers_2d2d = 0;  // what Select decides by
    bool chosen = false;
  };
  std::vector<Candidate> candidates;
  // A lifted keypoint of the query; they are thinned evenly.
  struct Keypoint {
    Eigen::Vector2d pixel;
    bool is_inlier = false;
  };
  std::vector<Keypoint> keypoints;
};

// The same matches, many geometries: identical 2D-2D matches are lifted through every source,
// corrected and filtered in every way asked for, and estimated by every method, so that what
// differs in the results is what differs in the geometry.

std::string MethodTitle(const EstimatorOptions& options);  // "adaptive:sum_msac"

struct LocalizationGrid {
  std::vector<EstimatorOptions> methods;
  std::vector<FilterMode> filters = {FilterMode::kOff};
  ConsistencyThresholds filter_thresholds;  // of FilterMode::kFixed
  std::vector<AlignMode> alignments = {AlignMode::kOff};
  CandidateOptions candidates = {};
  std::vector<Threshold> thresholds;
  uint64_t seed = 0;  // of the bootstrap
  int threads = 0;
};

// One configuration of localization with its ratings. What does not matter to its method is empty
// (E5+1 needs no geometry).
struct LocalizationRow {
  std::string source, alignment, filter, method;
  bool is_oracle = false;  // chosen with the ground truth
  Comparison comparison;
  ResultSummary summary;
  std::vector<Interval> recalls;  // 95 %, one per threshold
  Interval median_position;
  // For each threshold, the recall minus that of the best row that is no oracle; where the interval
  // contains 0, the difference may be chance.
  std::vector<Interval> difference_to_best;
  bool is_best = false;                        // at any threshold
  std::vector<double> median_inliers;          // 2D-3D and 2D-2D
  std::map<std::string, QueryDetail> details;  // by the query's name; of an oracle: none

  std::string Name() const;  // "mesh, off, off, p3p"
};

struct LocalizationComparison {
  std::vector<Threshold> thresholds;
  std::vector<LocalizationRow> rows;
};

// Hooks are called from any thread.
struct LocalizationHooks {
  std::function<void()> on_query = {};
  // Returns the kept JSON of all configurations for a query, for a run that goes on; nullopt where
  // there is none. The query is then localized, as where the JSON makes no sense.
  std::function<std::optional<std::string>(size_t query)> kept = {};
  std::function<void(size_t query, const std::string& outcomes)> keep = {};
};

// Localizes the queries by each source of the scene alone. `reference_matches` align depth where
// the grid asks for it; `ground_truth` must hold queries.
LocalizationComparison CompareLocalization(const Scene& scene, std::span<const Query> queries,
                                           std::shared_ptr<const MatchSource> matches,
                                           std::span<const ReferenceMatch> reference_matches,
                                           const PosesByName& ground_truth,
                                           const LocalizationGrid& grid,
                                           const LocalizationHooks& hooks = {});

std::string FormatLocalizationText(const LocalizationComparison& comparison);
std::string FormatLocalizationCsv(const LocalizationComparison& comparison);
std::string FormatLocalizationJson(const LocalizationComparison& comparison);

}  // namespace raylift
