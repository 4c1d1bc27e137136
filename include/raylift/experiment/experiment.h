// An experiment and its file: scenes, a grid of ways to localize in them, and the tables, figures
// and claims that are made of the results.

#pragma once

#include <array>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/estimation/options.h"
#include "raylift/evaluation/perturbation.h"
#include "raylift/evaluation/pose_errors.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/lifting/consistency_filter.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/lifter.h"

namespace raylift {

enum class Axis { kScene, kEvery, kGeometry, kAlign, kFilter, kMethod, kScore, kLo, kAlpha };
template <>
inline constexpr auto kEnumNames<Axis> = std::to_array<EnumName<Axis>>({
    {Axis::kScene, "scene", "Scene"},
    {Axis::kEvery, "every", "References"},
    {Axis::kGeometry, "geometry", "Geometry"},
    {Axis::kAlign, "align", "Alignment"},
    {Axis::kFilter, "filter", "Filter"},
    {Axis::kMethod, "method", "Method"},
    {Axis::kScore, "score", "Scoring"},
    {Axis::kLo, "lo", "LO"},
    {Axis::kAlpha, "alpha"},
});
constexpr size_t kNumAxes = kEnumNames<Axis>.size();

// Returns whether an axis is part of the method rather than of its input.
constexpr bool IsOfMethod(Axis axis) { return axis >= Axis::kMethod; }

// Stands for a method: the better pose of P3P's and E5+1's, chosen with the ground truth.
struct Oracle {
  auto operator<=>(const Oracle&) const = default;
};
constexpr std::string_view kOracleName = "oracle";

// A value on an axis:
//   scene, geometry, filter   the name that the experiment gives it
//   every                     size_t
//   method                    Method or Oracle
//   align, score, lo          the enum
//   alpha                     double
// std::monostate where the axis does not matter to the setting (E5+1 needs no geometry, P3P has no
// score).
using AxisValue = std::variant<std::monostate, std::string, size_t, AlignMode, Method, Oracle,
                               ScoreCombination, LocalOptimization, double>;
inline bool Matters(const AxisValue& value) {
  return !std::holds_alternative<std::monostate>(value);
}
// Returns the text of a value in files and tables; empty for std::monostate.
std::string TextOf(const AxisValue& value);

struct Setting {
  std::array<AxisValue, kNumAxes> values;

  AxisValue& operator[](Axis axis) { return values[static_cast<size_t>(axis)]; }
  const AxisValue& operator[](Axis axis) const { return values[static_cast<size_t>(axis)]; }
  // The compiler compares an ordering with zero, which is no null pointer.
  auto operator<=>(const Setting&) const = default;  // NOLINT(modernize-use-nullptr)

  // Returns the value on an axis where it matters and is of this type, else null.
  template <typename T>
  const T* Find(Axis axis) const {
    return std::get_if<T>(&(*this)[axis]);
  }
  // Return the values on the axes that matter to every setting of a grid.
  const std::string& Scene() const { return std::get<std::string>((*this)[Axis::kScene]); }
  size_t Every() const { return std::get<size_t>((*this)[Axis::kEvery]); }
  bool Is(Method method) const { return (*this)[Axis::kMethod] == AxisValue(method); }
  bool IsOracle() const { return Find<Oracle>(Axis::kMethod) != nullptr; }

  // Returns "scene=demo every=5 ..." of the values that matter.
  std::string Name() const;
};

// Values that settings may have on some axes; an axis that is not named may have any.
struct Selection {
  std::map<Axis, std::vector<AxisValue>> values;

  // Returns whether the setting's values are selected. A value that does not matter to it matches.
  bool Matches(const Setting& setting) const;
};

// The geometry of a setting: its sources, and how their points are combined. "{every}" in a
// specification stands for the subsampling.
struct ExperimentGeometry {
  std::string name;
  std::string title;  // in tables
  // Specifications as in --geometry, in the order in which they are asked; empty where points are
  // triangulated.
  std::vector<std::string> specs;
  GeometryMode mode = GeometryMode::kFirst;
  CandidateOptions candidates = {};
  // Perturbation of the depth maps of the one source, at the references' size.
  std::optional<DepthPerturbation> perturbation = std::nullopt;
};

// "{every}" in the paths of features, matches and pairs stands for the subsampling.
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

// Stands for all combinations of the values. An empty list stands for the axis' default.
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

// A table, or a figure of curves over the subsampling: its rows are the lines, its columns the
// panels.
struct TableLayout {
  std::string name;  // of its files
  std::string title;
  std::vector<LayoutAxis> rows, columns;
  TableValue value = TableValue::kRecalls;
  Selection where;
};

// States that one method is better than another, or not worse, judged by the paired bootstrap.
struct Claim {
  enum class Relation { kBetter, kNotWorse };
  std::string name;
  std::string text;
  Selection where;
  Selection first;
  Selection second;  // of several, the best one
  Relation relation = Relation::kBetter;
  // Where both are given, the claim is on the change of the value between the two.
  Selection from, to;
};
template <>
inline constexpr auto kEnumNames<Claim::Relation> = std::to_array<EnumName<Claim::Relation>>({
    {Claim::Relation::kBetter, "better"},
    {Claim::Relation::kNotWorse, "not_worse"},
});

// The references from which every N-th one is taken.
enum class SubsamplingOffsets {
  kFirst,  // at the first
  kAll,    // at each of the first N, pooled as seeds are
};
template <>
inline constexpr auto kEnumNames<SubsamplingOffsets> = std::to_array<EnumName<SubsamplingOffsets>>({
    {SubsamplingOffsets::kFirst, "first"},
    {SubsamplingOffsets::kAll, "all"},
});

struct Experiment {
  std::filesystem::path file;
  std::string title;
  std::vector<ExperimentScene> scenes;
  std::vector<NamedFilter> filters;
  std::vector<GridBlock> blocks;
  std::vector<uint64_t> seeds = {0};
  SubsamplingOffsets offsets = SubsamplingOffsets::kFirst;
  EstimatorOptions estimator;  // all but method, score, local optimization, alpha and seed
  std::vector<TableLayout> tables;
  std::vector<TableLayout> figures;
  std::vector<Claim> claims;

  const ExperimentScene& SceneOf(const Setting& setting) const;
  // Returns the filter of a setting to which geometry matters.
  const NamedFilter& FilterOf(const Setting& setting) const;
  // Returns null where geometry does not matter to the setting, or its scene has none of that name.
  const ExperimentGeometry* GeometryOf(const Setting& setting) const;
};

// An experiment's file (TOML):
//
//   title = "The demo"
//   seeds = [0, 1, 2]
//   offsets = "all"                   # from each of the first N references every N-th, pooled
//
//   [scenes.demo]
//   scene = "demo/scene.toml"         # a scene file, and what it does not hold or shall not hold:
//   model = "demo/model"              # as the options of `raylift localize`: images, queries,
//   queries = "demo/queries.txt"      # query_images, features, matches, pairs, top_k, ...
//   ground_truth = "demo/truth"       # without: poses are written for a benchmark's server
//   thresholds = "0.1,1:0.25,2"
//   group = "night"                   # only the queries of this group
//   continuous = true                 # localized queries join the references
//   [scenes.demo.geometry]
//   mesh = "mesh:demo/scene.obj"
//   noisy = { spec = "mesh:demo/scene.obj", scale_sigma = 0.05 }   # as `raylift perturb`
//   both = { spec = ["sfm", "mesh:demo/scene.obj"], mode = "all", candidates = "merge" }
//
//   [filters."2 px"]
//   reprojection_px = 2
//
//   [[grid]]                          # all combinations; several blocks are joined
//   every = [1, 2, 5]
//   method = ["p3p", "e5p1", "adaptive", "oracle"]
//   score = ["sum_inl", "sum_msac"]
//
//   [[table]]
//   name = "methods"
//   rows = ["method", "score"]
//   columns = ["scene", "every"]
//
//   [[claim]]
//   text = "P3P wins where references are dense"
//   where = { every = 1 }
//   first = { method = "p3p" }
//   second = { method = "e5p1" }
//
// Paths are relative to the file; ${NAME} in any text stands for a variable.
using VariableLookup = std::function<std::optional<std::string>(const std::string& name)>;

// Reads an experiment. A scene file that is not there is only noted
// (ExperimentScene::file_is_missing), so that an experiment can be looked at without its data.
// Throws InputError with the file and the key for what is missing, unknown, of the wrong kind or
// out of range.
Experiment ReadExperiment(const std::filesystem::path& file, const VariableLookup& variables);

// Returns every setting of the grid once, in the order of the file. Throws InputError naming the
// file where a block names what is not there.
std::vector<Setting> ExpandGrid(const Experiment& experiment);

// Returns whether a setting's results are chosen from those of P3P and E5+1, without estimating:
// the oracle's always, Select's unless the filter is automatic, which treats P3P alone differently,
// or localization is continuous.
bool IsChosen(const Setting& setting, const Experiment& experiment);

// Returns the settings that must be estimated to get the results of these, each once.
std::vector<Setting> SettingsToEstimate(const std::vector<Setting>& settings,
                                        const Experiment& experiment);
// Return the P3P and E5+1 settings that a chosen one is chosen from.
Setting P3pOf(const Setting& setting);
Setting E5p1Of(const Setting& setting);

}  // namespace raylift
