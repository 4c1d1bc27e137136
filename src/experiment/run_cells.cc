#include "raylift/experiment/run_cells.h"

#include <algorithm>
#include <atomic>
#include <map>
#include <memory>
#include <tuple>

#include "continuous_cells.h"
#include "perturbed_depth.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/hash.h"
#include "raylift/base/parallel.h"
#include "raylift/base/text.h"
#include "raylift/geometry/pose_convention.h"
#include "raylift/lifting/aligned_source.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/lifting/lifter.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene_matches.h"

namespace raylift {
namespace {

using std::filesystem::path;

EstimatorOptions EstimatorOf(const Experiment& experiment, const Cell& cell) {
  EstimatorOptions options = experiment.estimator;
  const Setting& setting = cell.setting;
  options.method = MethodFromName(setting[Axis::kMethod]).value();
  if (const auto score = ScoreCombinationFromName(setting[Axis::kScore])) options.score = *score;
  if (const auto lo = LocalOptimizationFromName(setting[Axis::kLo])) {
    options.local_optimization = *lo;
  }
  if (const auto alpha = ParseDouble(setting[Axis::kAlpha])) options.alpha = *alpha;
  options.seed = cell.seed;
  return options;
}

FewPoints FewPointsOf(const Setting& setting) {
  const auto method = MethodFromName(setting[Axis::kMethod]);
  const bool needs_points = method == Method::kP3p || method == Method::kHloc;
  return needs_points ? FewPoints::kKeepBest : FewPoints::kDropAll;
}

QueryOutcome OutcomeOf(const PoseProblem& problem, const PoseEstimate& estimate) {
  QueryOutcome outcome;
  outcome.name = problem.name;
  outcome.cam_from_world = estimate.cam_from_world;
  outcome.position_observable = estimate.position_observable;
  outcome.reason = ReasonNotLocalized(estimate);
  outcome.inliers_2d3d = estimate.score_2d3d.num_inliers;
  outcome.inliers_2d2d = estimate.score_2d2d.num_inliers;
  outcome.matches_2d3d = static_cast<int>(problem.matches_2d3d.size());
  outcome.matches_2d2d = static_cast<int>(problem.matches_2d2d.size());
  outcome.solver = estimate.solver;
  return outcome;
}

// Names the geometry by all that it depends on.
std::string GeometryHash(const Cell& cell) {
  const auto inputs = nlohmann::json::parse(cell.inputs);
  return HexText(HashBytes64(inputs.at("geometry").dump() + inputs.at("scene").at("model").dump()));
}

// Every n-th reference from `first` on.
ReferenceSet Thinned(ReferenceSet all, size_t every, size_t first) {
  ReferenceSet thinned;
  thinned.model = std::move(all.model);
  for (size_t i = 0; i < all.images.size(); ++i) {
    if (i % every == first) {
      thinned.images.push_back(std::move(all.images[i]));
    } else {
      thinned.thinned_out.push_back(std::move(all.images[i].name));
    }
  }
  if (thinned.images.empty()) {
    throw InputError(thinned.model, fmt::format("holds no more than {} references", first));
  }
  return thinned;
}

// The geometry and alignment that cells share.
using GeometryKey = std::pair<std::string, std::string>;

// One thinning of a scene.
class ThinnedScene {
 public:
  ThinnedScene(const Experiment& experiment, const ExperimentScene& scene, std::string every,
               size_t offset, const RunCellsOptions& options)
      : experiment_(experiment),
        scene_(scene),
        every_(std::move(every)),
        options_(options),
        queries_(QueriesOf(scene)) {
    LoadedReferences loaded =
        LoadReferences(scene.model, 1, PoseConventionFromName(scene.model_poses).value());
    references_ = Thinned(std::move(loaded.references), ParseUint(every_).value(), offset);
    covisibility_ = std::move(loaded.covisibility);
    Take(std::move(loaded.warnings));
    matches_ = OpenMatches();
  }

  // Cells of one block of queries.
  void Run(std::span<const Cell> cells, const CellStore& store) {
    if (scene_.continuous) {
      for (const Cell& cell : cells) store.Write(cell, RunContinuously(cell));
      return;
    }
    const std::vector<PoseProblem> matched = MatchQueries(cells.front().begin, cells.front().end);
    std::map<GeometryKey, std::vector<Cell>> by_geometry;
    for (const Cell& cell : cells) {
      by_geometry[{cell.setting[Axis::kGeometry], cell.setting[Axis::kAlign]}].push_back(cell);
    }
    for (const auto& [key, of_geometry] : by_geometry) {
      if (key.first.empty()) {
        Estimate(of_geometry, matched, store);
        continue;
      }
      OpenSource(key, of_geometry.front());
      const std::vector<PoseProblem> lifted = Lift(*sources_.at(key), matched);
      std::map<std::pair<std::string, FewPoints>, std::vector<Cell>> by_filter;
      for (const Cell& cell : of_geometry) {
        by_filter[{cell.setting[Axis::kFilter], FewPointsOf(cell.setting)}].push_back(cell);
      }
      for (const auto& [filter, of_filter] : by_filter) {
        Estimate(of_filter, Filter(key, filter.first, filter.second, lifted), store);
      }
    }
  }

  std::vector<std::string> TakeWarnings() {
    Take(matches_->Warnings());
    return std::move(warnings_);
  }

 private:
  void Take(std::vector<std::string> warnings) {
    for (std::string& warning : warnings) {
      warnings_.push_back(fmt::format("{}, 1/{}: {}", scene_.name, every_, warning));
    }
  }

  // With a number, up to so many localized queries may be among a query's references.
  std::unique_ptr<MatchSource> OpenMatches(std::optional<int> max_joined = std::nullopt) const {
    if (!scene_.features.empty()) {
      JoiningQueries joining;
      if (max_joined) joining = {queries_, *max_joined};
      return OpenHlocMatches(
          {ForThinning(scene_.features, every_), ForThinning(scene_.matches, every_),
           ForThinning(scene_.pairs, every_)},
          references_, scene_.top_k, joining);
    }
    return MakeFrontEndMatches({.reference_images = scene_.images,
                                .query_images = scene_.query_images,
                                .cache = options_.cache / "features" / scene_.name,
                                .top_k = scene_.top_k,
                                .max_features = scene_.max_features,
                                .threads = options_.threads,
                                .show_progress = false,
                                .max_joined = max_joined},
                               references_, queries_);
  }

  std::vector<PoseProblem> MatchQueries(size_t begin, size_t end) const {
    std::vector<PoseProblem> problems(end - begin);
    ParallelFor(problems.size(), options_.threads, [&](size_t i) {
      const Query& query = queries_[begin + i];
      QueryMatches matches = matches_->Match(query);
      PoseProblem& problem = problems[i];
      problem.name = query.name;
      problem.query_camera = query.camera;
      problem.references = std::move(matches.references);
      problem.reference_clusters = covisibility_.Clusters(problem.references);
      problem.matches_2d2d = std::move(matches.matches);
    });
    return problems;
  }

  void OpenSource(const GeometryKey& key, const Cell& cell) {
    if (sources_.contains(key)) return;
    const ExperimentGeometry& geometry = *scene_.FindGeometry(key.first);
    NamedGeometry opened =
        MakeGeometrySource(SpecOf(geometry, cell), {.model = scene_.model,
                                                    .references = references_.images,
                                                    .thinned_out = references_.thinned_out});
    Take(std::move(opened.warnings));
    std::shared_ptr<const GeometrySource> source = std::move(opened.source);
    const AlignMode mode = AlignModeFromName(key.second).value();
    if (mode != AlignMode::kOff && opened.kind != GeometryKind::kSfm) {
      if (!reference_matches_) {
        reference_matches_ =
            CollectReferenceMatches(queries_, *matches_, references_, options_.threads);
      }
      const DepthAlignment alignment = AlignDepth(*source, references_.images, *reference_matches_,
                                                  {.mode = mode}, options_.threads);
      source = std::make_shared<AlignedSource>(source, alignment.Corrections());
    }
    sources_.emplace(key, std::move(source));
  }

  // Depth that is made worse is written for all references: other thinnings use it, too.
  std::string SpecOf(const ExperimentGeometry& geometry, const Cell& cell) const {
    const std::string spec = ForThinning(geometry.spec, every_).string();
    if (!geometry.perturbation) return spec;
    const LoadedReferences all =
        LoadReferences(scene_.model, 1, PoseConventionFromName(scene_.model_poses).value());
    return WritePerturbedDepth(options_.cache / "depth" / scene_.name / GeometryHash(cell), spec,
                               {.model = scene_.model, .references = all.references.images},
                               *geometry.perturbation, options_.threads);
  }

  std::vector<PoseProblem> Lift(const GeometrySource& source,
                                std::span<const PoseProblem> matched) const {
    std::vector<PoseProblem> problems(matched.begin(), matched.end());
    ParallelFor(problems.size(), options_.threads, [&](size_t i) {
      problems[i].matches_2d3d =
          Matches2D3D(LiftMatches(source, problems[i].references, problems[i].matches_2d2d));
    });
    return problems;
  }

  std::vector<PoseProblem> Filter(const GeometryKey& key, const std::string& name,
                                  FewPoints few_points, std::span<const PoseProblem> lifted) {
    const FilterOptions options = FilterOf(key, name, few_points);
    std::vector<PoseProblem> problems(lifted.begin(), lifted.end());
    ParallelFor(problems.size(), options_.threads,
                [&](size_t i) { FilterProblem(options, problems[i]); });
    return problems;
  }

  FilterOptions FilterOf(const GeometryKey& key, const std::string& name, FewPoints few_points) {
    const NamedFilter& filter = experiment_.FilterNamed(name);
    FilterOptions options{
        .mode = filter.mode, .thresholds = filter.thresholds, .few_points = few_points};
    if (filter.mode == FilterMode::kAuto) options.scene_noise = SceneNoise(key);
    return options;
  }

  std::vector<QueryOutcome> RunContinuously(const Cell& cell) {
    const GeometryKey key(cell.setting[Axis::kGeometry], cell.setting[Axis::kAlign]);
    std::vector<const GeometrySource*> geometry;
    FilterOptions filter;
    if (!key.first.empty()) {
      OpenSource(key, cell);
      geometry.push_back(sources_.at(key).get());
      filter = FilterOf(key, cell.setting[Axis::kFilter], FewPointsOf(cell.setting));
    }
    const auto matches = OpenMatches(std::max(1, scene_.top_k / 2));
    return RunContinuousCell({.scene = scene_,
                              .queries = queries_,
                              .references = references_,
                              .matches = *matches,
                              .geometry = geometry,
                              .filter = filter,
                              .estimator = EstimatorOf(experiment_, cell),
                              .checkpoint = options_.cache / "continuous" / cell.Key(),
                              .key = cell.Key(),
                              .threads = options_.threads,
                              .on_estimate = options_.on_estimate});
  }

  std::optional<MultiViewNoise> SceneNoise(const GeometryKey& key) {
    const auto known = noise_.find(key);
    if (known != noise_.end()) return known->second;
    const GeometrySource* source = sources_.at(key).get();
    const auto estimator = MakePoseEstimator(experiment_.estimator);
    const FilterOptions off;
    const auto noise = EstimateSceneNoise(queries_,
                                          {.match_source = *matches_,
                                           .covisibility = covisibility_,
                                           .geometry = std::span(&source, 1),
                                           .filter = off,
                                           .estimator = *estimator},
                                          options_.threads);
    return noise_.emplace(key, noise).first->second;
  }

  // All queries of all cells at once; a cell is written by who estimates its last query.
  void Estimate(std::span<const Cell> cells, std::span<const PoseProblem> problems,
                const CellStore& store) const {
    struct InHand {
      std::unique_ptr<PoseEstimator> estimator;
      std::vector<QueryOutcome> outcomes;
      std::atomic<size_t> left;
    };
    std::vector<InHand> in_hand(cells.size());
    for (size_t c = 0; c < cells.size(); ++c) {
      in_hand[c].estimator = MakePoseEstimator(EstimatorOf(experiment_, cells[c]));
      in_hand[c].outcomes.resize(problems.size());
      in_hand[c].left = problems.size();
    }
    ParallelFor(cells.size() * problems.size(), options_.threads, [&](size_t i) {
      InHand& cell = in_hand[i / problems.size()];
      const size_t q = i % problems.size();
      cell.outcomes[q] = OutcomeOf(problems[q], cell.estimator->Estimate(problems[q]));
      if (options_.on_estimate) options_.on_estimate();
      if (--cell.left == 0) store.Write(cells[i / problems.size()], cell.outcomes);
    });
  }

  const Experiment& experiment_;
  const ExperimentScene& scene_;
  std::string every_;
  const RunCellsOptions& options_;
  std::vector<Query> queries_;
  ReferenceSet references_;
  Covisibility covisibility_;
  std::unique_ptr<MatchSource> matches_;
  std::map<GeometryKey, std::shared_ptr<const GeometrySource>> sources_;
  std::optional<std::vector<ReferenceMatch>> reference_matches_;
  std::map<GeometryKey, std::optional<MultiViewNoise>> noise_;
  std::vector<std::string> warnings_;
};

// The end of the cells from `begin` on that are alike.
template <typename KeyOf>
size_t EndOfGroup(std::span<const Cell> cells, size_t begin, const KeyOf& key_of) {
  size_t end = begin + 1;
  while (end < cells.size() && key_of(cells[end]) == key_of(cells[begin])) ++end;
  return end;
}

}  // namespace

std::vector<std::string> RunCells(const Experiment& experiment, std::span<const Cell> cells,
                                  const CellStore& store, const RunCellsOptions& options) {
  std::vector<std::string> warnings;
  const auto thinning = [](const Cell& cell) {
    return std::tuple(cell.setting[Axis::kScene], cell.setting[Axis::kEvery], cell.offset);
  };
  for (size_t begin = 0; begin < cells.size();) {
    const size_t end = EndOfGroup(cells, begin, thinning);
    const Setting& setting = cells[begin].setting;
    ThinnedScene scene(experiment, experiment.SceneOf(setting), setting[Axis::kEvery],
                       cells[begin].offset, options);
    const auto of_scene = cells.subspan(begin, end - begin);
    for (size_t first = 0; first < of_scene.size();) {
      const size_t last = EndOfGroup(of_scene, first, [](const Cell& cell) { return cell.begin; });
      scene.Run(of_scene.subspan(first, last - first), store);
      first = last;
    }
    for (std::string& warning : scene.TakeWarnings()) warnings.push_back(std::move(warning));
    begin = end;
  }
  return warnings;
}

}  // namespace raylift
