#include "raylift/experiment/run_cells.h"

#include <algorithm>
#include <atomic>
#include <memory>
#include <tuple>

#include "base/hash.h"
#include "base/json_text.h"
#include "localization/calibration_images.h"
#include "localization/continuous/continuous_localizer.h"
#include "localization/results/query_job.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/base/text.h"
#include "raylift/evaluation/perturbation.h"
#include "raylift/io/depth_file.h"
#include "raylift/io/scene_file.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/localization/localize_all.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Writes geometry made worse on purpose as depth maps of the references, unless the folder is
// complete, and returns its specification. Throws InputError where the geometry is neither a mesh
// nor depth maps.
std::string WritePerturbedDepth(const path& folder, const std::string& spec,
                                const GeometryContext& context,
                                const DepthPerturbation& perturbation, int threads) {
  const path complete = folder / "complete";
  if (!std::filesystem::exists(complete)) {
    GeometryContext opening = context;
    opening.threads = threads;
    const NamedGeometry geometry = MakeGeometrySource(spec, opening);
    if (geometry.Surface() == nullptr && geometry.maps == nullptr) {
      throw InputError("only meshes, point clouds, splats and depth maps can be perturbed, not " +
                       spec);
    }
    std::vector<path> files(context.references.size());
    ParallelFor(files.size(), threads, [&](size_t i) {
      const PosedImage& image = context.references[i];
      if (const auto map = geometry.MapOf(image)) {
        // Where "depth:FOLDER" finds it.
        files[i] = PathBelow(folder, image.name).replace_extension("npy");
        const CommittedFiles synced_later(CommittedFiles::Sync::kByPromise);
        WriteDepthFile(files[i], PerturbDepth(*map, perturbation, image.name));
      }
    });
    std::erase(files, path());
    SyncFiles(files);
    WriteFile(complete, "");
  }
  return "depth:" + folder.string() + ",unit=1";
}

EstimatorOptions EstimatorOf(const Experiment& experiment, const Cell& cell) {
  EstimatorOptions options = experiment.estimator;
  const Setting& setting = cell.setting;
  options.method = *setting.Find<Method>(Axis::kMethod);
  if (const auto* score = setting.Find<ScoreCombination>(Axis::kScore)) options.score = *score;
  if (const auto* lo = setting.Find<LocalOptimization>(Axis::kLo)) {
    options.local_optimization = *lo;
  }
  if (const auto* alpha = setting.Find<double>(Axis::kAlpha)) options.alpha = *alpha;
  options.seed = cell.seed;
  return options;
}

QueryOutcome OutcomeOf(const LocalizedQuery& localized) {
  const PoseEstimate& estimate = localized.estimate;
  QueryOutcome outcome;
  outcome.name = localized.name;
  outcome.cam_from_world = estimate.cam_from_world;
  outcome.position_observable = estimate.position_observable;
  outcome.reason = localized.reason;
  outcome.inliers_2d3d = static_cast<int>(localized.counts.inliers_2d3d);
  outcome.inliers_2d2d = static_cast<int>(localized.counts.inliers_2d2d);
  outcome.matches_2d3d = static_cast<int>(localized.counts.points);
  outcome.matches_2d2d = static_cast<int>(localized.counts.matched);
  outcome.solver = estimate.solver;
  return outcome;
}

// Names the geometry by all that it depends on.
std::string GeometryHash(const Cell& cell) {
  const auto inputs = nlohmann::json::parse(cell.inputs);
  return HexText(HashBytes64(inputs.at("geometry").dump() + inputs.at("scene").at("model").dump()));
}

// The geometry and alignment that cells share.
using GeometryKey = std::pair<AxisValue, AxisValue>;
GeometryKey KeyOf(const Cell& cell) {
  return {cell.setting[Axis::kGeometry], cell.setting[Axis::kAlign]};
}

std::vector<size_t> ContinuousOrder(const ExperimentScene& scene, std::span<const Query> queries,
                                    std::span<const PosedImage> references) {
  if (scene.times.empty()) return OrderByName(queries);
  return OrderByTime(queries, references, ReadTimes(scene.times), scene.times);
}

std::vector<QueryOutcome> OutcomesOf(std::span<const QueryRecord> records) {
  std::vector<QueryOutcome> outcomes;
  for (const QueryRecord& record : records) outcomes.push_back(OutcomeOf(record.localized));
  return outcomes;
}

constexpr size_t kMostBytesOfMatches = size_t{2} << 30;

// The references of one subsampling of a scene, with what its cells share.
class SubsampledScene {
 public:
  SubsampledScene(const Experiment& experiment, const ExperimentScene& scene, size_t every,
                  size_t offset, const RunCellsOptions& options)
      : experiment_(experiment),
        settings_(scene),
        every_(every),
        options_(options),
        queries_(QueriesOf(scene)),
        references_(OpenScene(
            {.model = scene.model,
             .model_poses = scene.model_poses,
             .subsampling = {.every = static_cast<int>(every), .offset = static_cast<int>(offset)},
             .images = scene.images})),
        matches_(std::make_shared<CachedMatches>(OpenMatches(), kMostBytesOfMatches)),
        images_(ImagesToCalibrateBy(references_.references, matches_, queries_)) {
    Take(references_.warnings);
  }

  // Fills the cells of one block of queries.
  void Run(std::span<const Cell> cells, const CellStore& store) {
    if (settings_.continuous) {
      for (const Cell& cell : cells) Keep(cell, RunContinuously(cell), store);
      return;
    }
    std::map<GeometryKey, std::vector<Cell>> by_geometry;
    for (const Cell& cell : cells) by_geometry[KeyOf(cell)].push_back(cell);
    for (const auto& [key, of_geometry] : by_geometry) {
      std::vector<Localizer> configurations;
      for (const Cell& cell : of_geometry) {
        configurations.emplace_back(SceneOf(cell), matches_, LocalizerOptionsOf(cell));
      }
      LocalizeAll localizer(std::move(configurations), queries_, matches_, options_.threads);
      localizer.Calibrate();
      Estimate(of_geometry, localizer, store);
    }
  }

  std::vector<std::string> TakeWarnings() {
    Take(matches_->Warnings());
    return std::move(warnings_);
  }

 private:
  void Take(std::vector<std::string> warnings) {
    for (std::string& warning : warnings) {
      warnings_.push_back(fmt::format("{}, 1/{}: {}", settings_.name, every_, warning));
    }
  }

  // A cell is written by who estimates its last query.
  void Estimate(std::span<const Cell> cells, const LocalizeAll& localizer,
                const CellStore& store) const {
    const size_t begin = cells.front().begin;
    const size_t count = cells.front().end - begin;
    struct InHand {
      std::vector<QueryOutcome> outcomes;
      std::atomic<size_t> left;
    };
    std::vector<InHand> in_hand(cells.size());
    for (InHand& cell : in_hand) {
      cell.outcomes.resize(count);
      cell.left = count;
    }
    // Few queries leave threads for the configurations of each.
    const bool enough = count >= static_cast<size_t>(ResolveThreads(options_.threads));
    ParallelFor(count, options_.threads, [&](size_t query) {
      localizer.LocalizeQuery(begin + query, enough ? 1 : options_.threads,
                              [&](size_t index, const QueryResult& result) {
                                InHand& cell = in_hand[index];
                                cell.outcomes[query] = OutcomeOf(result.localized);
                                if (options_.on_estimate) options_.on_estimate();
                                if (--cell.left == 0) Keep(cells[index], cell.outcomes, store);
                              });
    });
  }

  void Keep(const Cell& cell, std::span<const QueryOutcome> outcomes,
            const CellStore& store) const {
    store.Write(cell, outcomes);
    if (options_.on_cell) options_.on_cell(cell);
  }

  // Opens the matches. With a number, up to so many localized queries may be among a query's
  // references.
  std::shared_ptr<MatchSource> OpenMatches(std::optional<int> max_joined = std::nullopt) const {
    MatchingOptions matching{.top_k = settings_.top_k, .max_joined = max_joined};
    if (!settings_.features.empty()) {
      matching.hloc = HlocFiles{ForSubsampling(settings_.features, every_),
                                ForSubsampling(settings_.matches, every_),
                                ForSubsampling(settings_.pairs, every_)};
    }
    matching.front_end = {.query_images = settings_.query_images,
                          .cache = options_.cache / "features" / settings_.name,
                          .max_features = settings_.max_features,
                          .threads = options_.threads};
    return raylift::OpenMatches(references_, queries_, matching);
  }

  // Returns the scene with the cell's geometry, or with none where the cell needs none.
  std::shared_ptr<const Scene> SceneOf(const Cell& cell) {
    const GeometryKey key = KeyOf(cell);
    const auto known = scenes_.find(key);
    if (known != scenes_.end()) return known->second;
    Scene scene = references_;
    if (const auto* geometry = experiment_.GeometryOf(cell.setting)) {
      scene.warnings.clear();
      for (const std::string& spec : geometry->specs) {
        OpenGeometry(scene, SpecOf(*geometry, spec, cell),
                     {.wrap_source = options_.wrap_source, .threads = options_.threads});
      }
      Take(scene.warnings);
      const AlignMode mode = *cell.setting.Find<AlignMode>(Axis::kAlign);
      if (mode != AlignMode::kOff) scene = Aligned(scene, mode, Matches(), options_.threads);
    }
    return scenes_.emplace(key, std::make_shared<const Scene>(std::move(scene))).first->second;
  }

  // Returns the specification of a cell's geometry. Depth that is made worse is written for all
  // references: other subsamplings use it, too.
  std::string SpecOf(const ExperimentGeometry& geometry, const std::string& text,
                     const Cell& cell) const {
    std::string spec = ForSubsampling(text, every_).string();
    if (!geometry.perturbation) return spec;
    const Scene all = OpenScene({.model = settings_.model, .model_poses = references_.model_poses});
    return WritePerturbedDepth(options_.cache / "depth" / settings_.name / GeometryHash(cell), spec,
                               {.model = settings_.model, .references = all.references.images},
                               *geometry.perturbation, options_.threads);
  }

  const std::vector<ReferenceMatch>& Matches() {
    if (!reference_matches_) {
      reference_matches_ = CollectReferenceMatches(images_.images, *images_.matches,
                                                   references_.references, options_.threads);
    }
    return *reference_matches_;
  }

  LocalizerOptions LocalizerOptionsOf(const Cell& cell) {
    LocalizerOptions options{.estimator = EstimatorOf(experiment_, cell)};
    const ExperimentGeometry* geometry = experiment_.GeometryOf(cell.setting);
    if (geometry == nullptr) return options;
    const NamedFilter& filter = experiment_.FilterOf(cell.setting);
    options.filter = {.mode = filter.mode, .thresholds = filter.thresholds};
    options.geometry_mode = geometry->mode;
    options.candidates = geometry->candidates;
    if (filter.mode == FilterMode::kAuto) options.filter.multi_view_noise = NoiseOf(cell, options);
    return options;
  }

  std::optional<MultiViewNoise> NoiseOf(const Cell& cell, const LocalizerOptions& options) {
    const std::shared_ptr<const Scene> scene = SceneOf(cell);
    const auto known = noise_.find(scene);
    if (known != noise_.end()) return known->second;
    const auto noise = LearnGeometryNoise(images_, *scene, options, options_.threads);
    return noise_.emplace(scene, noise).first->second;
  }

  // A run that was killed goes on at the query it was at.
  std::vector<QueryOutcome> RunContinuously(const Cell& cell) {
    const path folder = options_.cache / "continuous" / cell.Key();
    QueryJob job(queries_, JsonText(nlohmann::ordered_json{{"cell", cell.Key()}}),
                 {.out = folder, .resume = true});
    job.Begin({});
    const LocalizerOptions options = LocalizerOptionsOf(cell);
    const int max_joined =
        JoinsAsInPaper(options.estimator) ? settings_.top_k : std::max(1, settings_.top_k / 2);
    const std::vector<size_t> order =
        ContinuousOrder(settings_, queries_, references_.references.images);
    const ContinuousRun run{
        .order = order,
        .done = job.Joined(),
        .threads = options_.threads,
        .on_done = [&](size_t i, const QueryResult& result, const JoinDecision& decision) {
          job.Add(i, {.localized = result.localized,
                      .diagnostics = decision.diagnostics,
                      .joined = decision.joined});
          if (options_.on_estimate) options_.on_estimate();
        }};
    for (size_t i = 0; i < run.done.size() && options_.on_estimate; ++i) options_.on_estimate();
    LocalizeContinuously(queries_, *SceneOf(cell), OpenMatches(max_joined), options, run);
    std::vector<QueryOutcome> outcomes = OutcomesOf(job.Whole().value());
    std::error_code ignored;
    std::filesystem::remove_all(folder, ignored);
    return outcomes;
  }

  const Experiment& experiment_;
  const ExperimentScene& settings_;
  size_t every_;
  const RunCellsOptions& options_;
  std::vector<Query> queries_;
  Scene references_;                            // without geometry
  std::shared_ptr<const MatchSource> matches_;  // kept, as cells that follow have the same
  CalibrationImages images_;
  std::map<GeometryKey, std::shared_ptr<const Scene>> scenes_;
  std::optional<std::vector<ReferenceMatch>> reference_matches_;
  std::map<std::shared_ptr<const Scene>, std::optional<MultiViewNoise>> noise_;
  std::vector<std::string> warnings_;
};

// Returns the end of the cells from `begin` on that have the same key.
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
  const auto subsampling = [](const Cell& cell) {
    return std::tuple(cell.setting[Axis::kScene], cell.setting[Axis::kEvery], cell.offset);
  };
  for (size_t begin = 0; begin < cells.size();) {
    const size_t end = EndOfGroup(cells, begin, subsampling);
    const Setting& setting = cells[begin].setting;
    SubsampledScene scene(experiment, experiment.SceneOf(setting), setting.Every(),
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
