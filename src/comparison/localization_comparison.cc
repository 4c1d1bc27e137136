#include "raylift/comparison/localization_comparison.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "base/statistics.h"
#include "geometry/pose_json.h"
#include "localization/calibration_images.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/base/text.h"
#include "raylift/evaluation/depth_errors.h"
#include "raylift/geometry/residuals.h"
#include "raylift/localization/localize_all.h"

namespace raylift {
namespace {

size_t CountInliers2D2D(const PoseProblem& problem, const Rigid3& cam_from_world,
                        double threshold_px) {
  size_t count = 0;
  for (const Match2D2D& match : problem.matches_2d2d) {
    const PosedImage& reference = problem.references[static_cast<size_t>(match.reference)];
    const auto error = SampsonError(problem.query_camera, cam_from_world, match.query_px,
                                    reference.camera, reference.cam_from_world, match.reference_px);
    count += error && std::abs(error->error_px) <= threshold_px;
  }
  return count;
}

// Returns the details of a query. `problem` is the estimated problem, `hit` the number of matches
// that were lifted, before filtering.
QueryDetail DescribeQuery(const PoseProblem& problem, size_t hit, const PoseEstimate& estimate,
                          const EstimatorOptions& options, const Rigid3& true_cam_from_world,
                          size_t max_keypoints) {
  QueryDetail detail;
  detail.retrieved = problem.references.size();
  detail.matched = problem.matches_2d2d.size();
  detail.hit = hit;
  detail.consistent = problem.matches_2d3d.size();
  detail.inliers_2d3d = static_cast<size_t>(std::max(0, estimate.score_2d3d.num_inliers));
  detail.inliers_2d2d = static_cast<size_t>(std::max(0, estimate.score_2d2d.num_inliers));
  detail.cam_from_world = estimate.cam_from_world;
  if (estimate.cam_from_world) detail.solver = ToString(estimate.solver);
  const auto add_candidate = [&](Solver solver, const std::optional<Rigid3>& pose) {
    if (!pose) return;
    detail.candidates.push_back({std::string(ToString(solver)),
                                 ComparePoses(*pose, true_cam_from_world),
                                 CountInliers2D2D(problem, *pose, options.sampson_threshold_px),
                                 estimate.cam_from_world && estimate.solver == solver});
  };
  add_candidate(Solver::kP3p, estimate.p3p_cam_from_world);
  add_candidate(Solver::kE5p1, estimate.e5p1_cam_from_world);
  const size_t count = problem.matches_2d3d.size();
  const size_t stride = max_keypoints > 0 ? count / max_keypoints + 1 : count + 1;
  for (size_t i = 0; max_keypoints > 0 && i < count; i += stride) {
    const bool is_inlier = i < estimate.inliers_2d3d.size() && estimate.inliers_2d3d[i];
    detail.keypoints.push_back({problem.matches_2d3d[i].query_px, is_inlier});
  }
  return detail;
}

// The result of one configuration for one query, as a comparison keeps it.
struct LocalizationOutcome {
  std::optional<Rigid3> cam_from_world;  // nullopt: not localized
  double inliers_2d3d = 0, inliers_2d2d = 0;
  QueryDetail detail;
};

}  // namespace

static void Members(JsonMembers& members, QueryDetail::Candidate& candidate) {
  members.Row(candidate.solver, candidate.error.position, candidate.error.rotation_deg,
              candidate.inliers_2d2d, candidate.chosen);
}

static void Members(JsonMembers& members, QueryDetail::Keypoint& keypoint) {
  members.Row(keypoint.pixel.x(), keypoint.pixel.y(), keypoint.is_inlier);
}

static void Members(JsonMembers& members, QueryDetail& detail) {
  members("counts", std::tie(detail.retrieved, detail.matched, detail.hit, detail.consistent,
                             detail.inliers_2d3d, detail.inliers_2d2d));
  members("solver", detail.solver);
  members("pose", detail.cam_from_world);
  members("candidates", detail.candidates);
  members("keypoints", detail.keypoints);
}

static void Members(JsonMembers& members, LocalizationOutcome& outcome) {
  members("pose", outcome.cam_from_world);
  members("inliers", std::tie(outcome.inliers_2d3d, outcome.inliers_2d2d));
  members("detail", outcome.detail);
}

namespace {

// Returns nullopt where the text is no such JSON, as of numbers that are not finite.
std::optional<std::vector<LocalizationOutcome>> ParseOutcomes(const std::string& text) {
  try {
    return ParseJson<std::vector<LocalizationOutcome>>(text);
  } catch (const InputError&) {
    return std::nullopt;
  }
}

// A configuration of the grid; fields that do not matter to it are empty.
struct Configuration {
  std::string source, alignment, filter;
  EstimatorOptions method;

  // Returns whether it is without filter and alignment: the keypoints of such rows are worth
  // keeping.
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
      : queries_(queries),
        matches_(std::make_shared<CachedMatches>(std::move(matches))),
        images_(ImagesToCalibrateBy(scene.references, matches_, queries)),
        grid_(grid) {
    for (const Query& query : queries) {
      const auto pose = ground_truth.find(query.name);
      if (pose != ground_truth.end()) truth_.insert(*pose);
    }
    if (truth_.empty()) throw InputError("the ground truth holds none of the queries");
    Scene without_geometry = scene;
    without_geometry.sources.clear();
    AddWithoutGeometry(without_geometry);
    for (const SceneSource& source : scene.sources) {
      Scene alone = without_geometry;
      alone.sources = {source};
      for (const AlignMode mode : grid.alignments) {
        AddConfigurations(Aligned(alone, mode, reference_matches, grid.threads), mode);
      }
    }
  }

  LocalizationComparison Run(const LocalizationHooks& hooks) {
    LocalizeAll localizer(localizers_, {queries_.begin(), queries_.end()}, matches_, grid_.threads);
    localizer.Calibrate();
    outcomes_.assign(queries_.size(), {});
    ParallelFor(queries_.size(), grid_.threads, [&](size_t query) {
      if (!TakeKept(query, hooks)) {
        outcomes_[query] = Localize(localizer, query);
        if (hooks.keep) hooks.keep(query, JsonText(ToJson(outcomes_[query])));
      }
      if (hooks.on_query) hooks.on_query();
    });
    LocalizationComparison result;
    result.thresholds = grid_.thresholds;
    for (size_t configuration = 0; configuration < configurations_.size(); ++configuration) {
      result.rows.push_back(MakeRow(configuration));
    }
    AddOracles(result.rows);
    Rate(result.rows);
    return result;
  }

 private:
  void AddWithoutGeometry(const Scene& scene) {
    const auto shared = std::make_shared<const Scene>(scene);
    for (const EstimatorOptions& method : grid_.methods) {
      if (!Uses2D3D(method.method))
        AddConfiguration(shared, {"", "", "", method}, {.candidates = grid_.candidates});
    }
  }

  void AddConfigurations(const Scene& scene, AlignMode alignment) {
    const auto shared = std::make_shared<const Scene>(scene);
    for (const FilterMode mode : grid_.filters) {
      LocalizerOptions options{.filter = {.mode = mode, .thresholds = grid_.filter_thresholds},
                               .candidates = grid_.candidates};
      options.filter.multi_view_noise = LearnGeometryNoise(images_, scene, options, grid_.threads);
      for (const EstimatorOptions& method : grid_.methods) {
        if (!Uses2D3D(method.method)) continue;
        AddConfiguration(shared,
                         {scene.sources.front().name, std::string(ToString(alignment)),
                          std::string(ToString(mode)), method},
                         options);
      }
    }
  }

  void AddConfiguration(const std::shared_ptr<const Scene>& scene, Configuration configuration,
                        LocalizerOptions options) {
    options.estimator = configuration.method;
    localizers_.emplace_back(scene, matches_, options);
    configurations_.push_back(std::move(configuration));
  }

  bool TakeKept(size_t query, const LocalizationHooks& hooks) {
    const auto text = hooks.kept ? hooks.kept(query) : std::nullopt;
    auto outcomes = text ? ParseOutcomes(*text) : std::nullopt;
    if (!outcomes || outcomes->size() != configurations_.size()) return false;
    outcomes_[query] = std::move(*outcomes);
    return true;
  }

  std::vector<LocalizationOutcome> Localize(const LocalizeAll& localizer, size_t query) const {
    std::vector<LocalizationOutcome> outcomes(configurations_.size());
    localizer.LocalizeQuery(query, 1, [&](size_t configuration, const QueryResult& result) {
      outcomes[configuration] = Keep(configurations_[configuration], result);
    });
    return outcomes;
  }

  LocalizationOutcome Keep(const Configuration& configuration, const QueryResult& result) const {
    const LocalizedQuery& localized = result.localized;
    LocalizationOutcome outcome;
    if (localized.localized()) outcome.cam_from_world = localized.estimate.cam_from_world;
    outcome.inliers_2d3d = localized.estimate.score_2d3d.num_inliers;
    outcome.inliers_2d2d = localized.estimate.score_2d2d.num_inliers;
    if (const auto pose = truth_.find(localized.name); pose != truth_.end()) {
      outcome.detail = DescribeQuery(result.problem, localized.counts.hit, localized.estimate,
                                     configuration.method, pose->second,
                                     configuration.IsPlain() ? kShownKeypoints : 0);
    }
    return outcome;
  }

  LocalizationRow MakeRow(size_t index) const {
    const Configuration& configuration = configurations_[index];
    LocalizationRow row;
    row.source = configuration.source;
    row.alignment = configuration.alignment;
    row.filter = configuration.filter;
    row.method = MethodTitle(configuration.method);
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

  // The oracle of P3P and E5+1 exists where both were run.
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

  // The best row has the highest recall, then the least median error.
  static bool IsBetter(const ResultSummary& a, const ResultSummary& b, size_t threshold) {
    return std::tuple(-a.recalls_percent[threshold], a.median_position) <
           std::tuple(-b.recalls_percent[threshold], b.median_position);
  }

  std::span<const Query> queries_;
  std::shared_ptr<const MatchSource> matches_;
  CalibrationImages images_;
  const LocalizationGrid& grid_;
  PosesByName truth_;
  std::vector<Configuration> configurations_;
  std::vector<Localizer> localizers_;                       // one for each configuration
  std::vector<std::vector<LocalizationOutcome>> outcomes_;  // of each query and configuration
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
