// What an experiment is: scenes, a grid of ways to localize in them, and the tables, figures and
// claims that are made of the results. The form of its file is in experiment_file.h.

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/evaluation/depth_perturbation.h"
#include "raylift/evaluation/recall.h"
#include "raylift/experiment/setting.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/lifting/candidates.h"
#include "raylift/lifting/consistency_filter.h"
#include "raylift/lifting/lifter.h"

namespace raylift {

// Where 3D points come from: sources of geometry, and what is made of their points. "{every}" in a
// specification stands for the thinning.
struct ExperimentGeometry {
  std::string name;
  std::string title;  // in tables
  // As in --geometry, in the order in which they are asked; none where points are triangulated.
  std::vector<std::string> specs;
  GeometryMode mode = GeometryMode::kFirst;
  CandidateOptions candidates = {};
  // Depth maps of the one source at the references' size, made worse.
  std::optional<DepthPerturbation> perturbation = std::nullopt;
};

// "{every}" in the paths of features, matches and pairs stands for the thinning.
struct ExperimentScene {
  std::string name;
  std::string title;
  std::filesystem::path file;  // a scene file (io/scene_file.h) that gave what follows, or empty
  bool file_is_missing = false;
  std::filesystem::path model;
  PoseConvention model_poses = PoseConvention::kCamFromWorld;
  std::filesystem::path images, query_images;  // for the built-in features
  std::filesystem::path queries;
  std::filesystem::path groups;        // of queries
  std::filesystem::path priors;        // of queries
  bool continuous = false;             // localized queries join the references
  std::filesystem::path times;         // their order; empty: by name
  std::string group;                   // only the queries of this group; empty: all
  std::filesystem::path ground_truth;  // empty: poses are written for a benchmark's server
  std::filesystem::path features, matches, pairs;
  int top_k = 20;
  int max_features = 4096;
  std::vector<Threshold> thresholds;
  std::vector<ExperimentGeometry> geometry;

  const ExperimentGeometry* FindGeometry(const std::string& name) const;
};

struct NamedFilter {
  std::string name;
  FilterMode mode = FilterMode::kOff;
  ConsistencyThresholds thresholds;
};

// All combinations of the values; an empty list: the axis' default.
struct GridBlock {
  Selection axes;
};

enum class TableValue {
  kRecalls,    // at all thresholds of the scene
  kMedian,     // position and rotation error
  kAuc,        // under the recall curve up to each threshold
  kLocalized,  // share of queries with a pose
};
template <>
inline constexpr auto kEnumNames<TableValue> = std::to_array<EnumName<TableValue>>({
    {TableValue::kRecalls, "recalls"},
    {TableValue::kMedian, "median"},
    {TableValue::kAuc, "auc"},
    {TableValue::kLocalized, "localized"},
});

// A part of the filter, to lay tables out by.
enum class FilterPart { kReprojectionPx, kMinViews, kMinRatio };
template <>
inline constexpr auto kEnumNames<FilterPart> = std::to_array<EnumName<FilterPart>>({
    {FilterPart::kReprojectionPx, "filter_reprojection_px", "RE thr."},
    {FilterPart::kMinViews, "filter_min_views", "in. thr."},
    {FilterPart::kMinRatio, "filter_min_ratio", "rel. thr."},
});
using LayoutAxis = std::variant<Axis, FilterPart>;

struct TableLayout {
  std::string name;  // of its files
  std::string title;
  std::vector<LayoutAxis> rows, columns;
  TableValue value = TableValue::kRecalls;
  Selection where;
};

// Curves over the thinning: one panel per value of `panels`, one line per value of `lines`.
struct FigureLayout {
  std::string name;
  std::string title;
  std::vector<LayoutAxis> panels, lines;
  TableValue value = TableValue::kRecalls;
  Selection where;
};

// That one way is better than another, or not worse, judged by the paired bootstrap.
struct Claim {
  enum class Relation { kBetter, kNotWorse };
  std::string name;
  std::string text;
  Selection where;
  Selection first;
  Selection second;  // of several, the best one
  Relation relation = Relation::kBetter;
  // Where both are given, what is compared is not the value but how it changes between the two.
  Selection from, to;
};
template <>
inline constexpr auto kEnumNames<Claim::Relation> = std::to_array<EnumName<Claim::Relation>>({
    {Claim::Relation::kBetter, "better"},
    {Claim::Relation::kNotWorse, "not_worse"},
});

// Where to begin to take every N-th reference.
enum class ThinningOffsets {
  kFirst,  // at the first
  kAll,    // at each of the first N, pooled as seeds are
};
template <>
inline constexpr auto kEnumNames<ThinningOffsets> = std::to_array<EnumName<ThinningOffsets>>({
    {ThinningOffsets::kFirst, "first"},
    {ThinningOffsets::kAll, "all"},
});

struct Experiment {
  std::filesystem::path file;
  std::string title;
  std::vector<ExperimentScene> scenes;
  std::vector<NamedFilter> filters;
  std::vector<GridBlock> blocks;
  std::vector<uint64_t> seeds = {0};
  ThinningOffsets offsets = ThinningOffsets::kFirst;
  EstimatorOptions estimator;  // all but method, score, local optimization, alpha and seed
  std::vector<TableLayout> tables;
  std::vector<FigureLayout> figures;
  std::vector<Claim> claims;

  const ExperimentScene& SceneOf(const Setting& setting) const;
  const NamedFilter& FilterNamed(const std::string& name) const;
  // Of a setting to which geometry matters.
  const NamedFilter& FilterOf(const Setting& setting) const;
  // Null where geometry does not matter to the setting, or its scene has none of that name.
  const ExperimentGeometry* GeometryOf(const Setting& setting) const;
};

}  // namespace raylift
