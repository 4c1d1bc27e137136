#include "raylift/comparison/localization_comparison.h"

#include <algorithm>
#include <memory>
#include <tuple>
#include <utility>

#include "base/statistics.h"
#include "localization/grid_localizer.h"
#include "localization_outcome.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/base/text.h"
#include "raylift/evaluation/depth_errors.h"

namespace raylift {
namespace {

// What tells one way to localize from the others; what does not matter to it is empty.
struct Way {
  std::string source, alignment, filter;
  EstimatorOptions method;

  // Without filter and alignment: the rows whose keypoints are worth keeping.
  bool IsPlain() const {
    const auto is_off = [](const std::string& name) { return name.empty() || name == "off"; };
    return is_off(filter) && is_off(alignment);
  }
};

constexpr size_t kShownKeypoints = 120;

class Runner {
 public:
  Runner(const Scene& scene, std::span<const Query> queries,
         std::shared_ptr<const MatchSource> matches,
         std::span<const ReferenceMatch> reference_matches, const PosesByName& ground_truth,
         const LocalizationGrid& grid)
      : queries_(queries), matches_(std::move(matches)), grid_(grid) {
    for (const Query& query : queries) {
      const auto pose = ground_truth.find(query.name);
      if (pose != ground_truth.end()) truth_.insert(*pose);
    }
    if (truth_.empty()) throw InputError("the ground truth holds none of the queries");
    Scene without_geometry = scene;
    without_geometry.sources.clear();
    AddWaysWithoutGeometry(without_geometry);
    for (const SceneSource& source : scene.sources) {
      Scene alone = without_geometry;
      alone.sources = {source};
      for (const AlignMode mode : grid.alignments) {
        AddWays(Aligned(alone, mode, reference_matches, grid.threads), mode);
      }
    }
  }

  LocalizationComparison Run(const LocalizationHooks& hooks) {
    GridLocalizer::Matched matched(queries_.size());
    const GridLocalizer localizer =
        GridLocalizer(localizers_).WithSceneNoise(queries_, matched, grid_.threads);
    outcomes_.assign(queries_.size(), {});
    ParallelFor(queries_.size(), grid_.threads, [&](size_t query) {
      if (!TakeKept(query, hooks)) {
        if (!matched[query]) matched[query] = localizer.way(0).Match(queries_[query]);
        outcomes_[query] = Localize(localizer, *matched[query]);
        if (hooks.keep) hooks.keep(query, FormatOutcomes(outcomes_[query]));
      }
      matched[query].reset();
      if (hooks.on_query) hooks.on_query();
    });
    LocalizationComparison result;
    result.thresholds = grid_.thresholds;
    for (size_t way = 0; way < ways_.size(); ++way) {
      result.rows.push_back(MakeRow(way));
    }
    AddOracles(result.rows);
    Rate(result.rows);
    return result;
  }

 private:
  void AddWaysWithoutGeometry(const Scene& scene) {
    const auto shared = std::make_shared<const Scene>(scene);
    for (const EstimatorOptions& method : grid_.methods) {
      if (!Uses2D3D(method.method))
        AddWay(shared, {"", "", "", method}, {.candidates = grid_.candidates});
    }
  }

  void AddWays(const Scene& scene, AlignMode alignment) {
    const auto shared = std::make_shared<const Scene>(scene);
    for (const FilterMode mode : grid_.filters) {
      LocalizerOptions options{.filter = {.mode = mode, .thresholds = grid_.filter_thresholds},
                               .candidates = grid_.candidates};
      options.filter.scene_noise =
          EstimateSceneNoise(queries_, scene, *matches_, options, grid_.threads);
      for (const EstimatorOptions& method : grid_.methods) {
        if (!Uses2D3D(method.method)) continue;
        AddWay(shared,
               {scene.sources.front().name, std::string(ToString(alignment)),
                std::string(ToString(mode)), method},
               options);
      }
    }
  }

  void AddWay(const std::shared_ptr<const Scene>& scene, Way way, LocalizerOptions options) {
    options.estimator = way.method;
    localizers_.emplace_back(scene, matches_, options);
    ways_.push_back(std::move(way));
  }

  bool TakeKept(size_t query, const LocalizationHooks& hooks) {
    const auto text = hooks.kept ? hooks.kept(query) : std::nullopt;
    auto outcomes = text ? ParseOutcomes(*text) : std::nullopt;
    if (!outcomes || outcomes->size() != ways_.size()) return false;
    outcomes_[query] = std::move(*outcomes);
    return true;
  }

  std::vector<LocalizationOutcome> Localize(const GridLocalizer& localizer,
                                            const QueryResult& matched) const {
    std::vector<LocalizationOutcome> outcomes(ways_.size());
    localizer.Localize(matched, 1, [&](size_t way, const QueryResult& result) {
      outcomes[way] = Keep(ways_[way], result);
    });
    return outcomes;
  }

  LocalizationOutcome Keep(const Way& way, const QueryResult& result) const {
    const LocalizedQuery& localized = result.localized;
    LocalizationOutcome outcome;
    if (localized.localized()) outcome.cam_from_world = localized.estimate.cam_from_world;
    outcome.inliers_2d3d = localized.estimate.score_2d3d.num_inliers;
    outcome.inliers_2d2d = localized.estimate.score_2d2d.num_inliers;
    if (const auto pose = truth_.find(localized.name); pose != truth_.end()) {
      outcome.detail = DescribeQuery(result.problem, localized.counts.hit, localized.estimate,
                                     way.method, pose->second, way.IsPlain() ? kShownKeypoints : 0);
    }
    return outcome;
  }

  LocalizationRow MakeRow(size_t index) const {
    const Way& way = ways_[index];
    LocalizationRow row;
    row.source = way.source;
    row.alignment = way.alignment;
    row.filter = way.filter;
    row.method = MethodTitle(way.method);
    PosesByName poses;
    std::vector<double> points, matches;
    for (size_t i = 0; i < queries_.size(); ++i) {
      const LocalizationOutcome& outcome = outcomes_[i][index];
      if (outcome.cam_from_world) poses.emplace(queries_[i].name, *outcome.cam_from_world);
      if (truth_.contains(queries_[i].name)) row.details.emplace(queries_[i].name, outcome.detail);
      points.push_back(outcome.inliers_2d3d);
      matches.push_back(outcome.inliers_2d2d);
    }
    row.comparison = CompareWithGroundTruth(truth_, poses);
    row.median_inliers = {MidpointMedianInPlace(std::span(points)),
                          MidpointMedianInPlace(std::span(matches))};
    return row;
  }

  // Of P3P and E5+1, where both were run.
  static void AddOracles(std::vector<LocalizationRow>& rows) {
    const auto e5p1 = std::find_if(rows.begin(), rows.end(), [](const LocalizationRow& row) {
      return row.method == ToString(Method::kE5p1);
    });
    if (e5p1 == rows.end()) return;
    const Comparison without_geometry = e5p1->comparison;
    std::vector<LocalizationRow> oracles;
    for (const LocalizationRow& row : rows) {
      if (row.method != ToString(Method::kP3p)) continue;
      LocalizationRow oracle = row;
      oracle.method = "oracle";
      oracle.is_oracle = true;
      oracle.details.clear();
      oracle.comparison = ChooseByOracle(row.comparison, without_geometry);
      oracles.push_back(std::move(oracle));
    }
    rows.insert(rows.end(), oracles.begin(), oracles.end());
  }

  void Rate(std::vector<LocalizationRow>& rows) const {
    const QueryBootstrap bootstrap(truth_.size(), grid_.seed);
    for (LocalizationRow& row : rows) {
      row.summary = Summarize(row.Name(), row.comparison, grid_.thresholds);
      row.median_position = bootstrap.MedianPosition(row.comparison);
    }
    for (size_t t = 0; t < grid_.thresholds.size(); ++t) {
      LocalizationRow* best = nullptr;
      for (LocalizationRow& row : rows) {
        row.recalls.push_back(bootstrap.RecallPercent(row.comparison, grid_.thresholds[t]));
        if (!row.is_oracle && (best == nullptr || IsBetter(row.summary, best->summary, t))) {
          best = &row;
        }
      }
      best->is_best = true;
      for (LocalizationRow& row : rows) {
        row.difference_to_best.push_back(bootstrap.RecallDifferencePercent(
            row.comparison, best->comparison, grid_.thresholds[t]));
      }
    }
  }

  // By recall, then by the median error.
  static bool IsBetter(const ResultSummary& a, const ResultSummary& b, size_t threshold) {
    return std::tuple(-a.recalls_percent[threshold], a.median_position) <
           std::tuple(-b.recalls_percent[threshold], b.median_position);
  }

  std::span<const Query> queries_;
  std::shared_ptr<const MatchSource> matches_;
  const LocalizationGrid& grid_;
  PosesByName truth_;
  std::vector<Way> ways_;
  std::vector<Localizer> localizers_;                       // one for each way
  std::vector<std::vector<LocalizationOutcome>> outcomes_;  // of each query, of each way
};

}  // namespace

std::string MethodTitle(const EstimatorOptions& options) {
  std::string name(ToString(options.method));
  switch (options.method) {
    case Method::kAdaptive:
      return fmt::format("{}:{}", name, ToString(options.score));
    case Method::kSelect:
      return fmt::format("{}:{}", name, FormatDouble(options.alpha));
    case Method::kP3p:
    case Method::kE5p1:
    case Method::kD3p1:
    case Method::kHybridRansac:
    case Method::kHloc:
      return name;
  }
  return name;
}

std::string LocalizationRow::Name() const {
  std::string name = method;
  for (const std::string* part : {&source, &alignment, &filter}) {
    if (!part->empty()) name += ", " + *part;
  }
  return name;
}

LocalizationComparison CompareLocalization(const Scene& scene, std::span<const Query> queries,
                                           std::shared_ptr<const MatchSource> matches,
                                           std::span<const ReferenceMatch> reference_matches,
                                           const PosesByName& ground_truth,
                                           const LocalizationGrid& grid,
                                           const LocalizationHooks& hooks) {
  return Runner(scene, queries, std::move(matches), reference_matches, ground_truth, grid)
      .Run(hooks);
}

}  // namespace raylift
