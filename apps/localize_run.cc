#include "localize_run.h"

#include <chrono>
#include <memory>
#include <optional>

#include "interrupt.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/base/progress.h"
#include "raylift/base/text.h"
#include "raylift/comparison/localization_report.h"
#include "raylift/io/image_file.h"
#include "raylift/io/pose_problem_json.h"
#include "raylift/io/query_list.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/localization/continuous_localizer.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/query_picture.h"
#include "raylift/localization/quick_doctor.h"
#include "raylift/localization/rerender.h"
#include "raylift/localization/result_files.h"
#include "raylift/localization/scene_matches.h"

namespace raylift {
namespace {

using std::filesystem::path;

// A file of a query of its own: its folders and its extension are kept, as a.jpg and a.png may both
// be queries; nothing leaves `folder`.
path FileOfQuery(const path& folder, const std::string& query, const char* extension) {
  return PathBelow(folder, query) += extension;
}

class LocalizeRun {
 public:
  LocalizeRun(const LocalizeFlags& flags, const GeometryOptions& geometry_options,
              const FilterOptions& filter, const EstimatorOptions& estimator_options)
      : flags_(flags),
        model_(flags.references.model),
        images_(flags.images),
        model_poses_(flags.model_poses.Resolve()),
        geometry_options_(geometry_options),
        filter_(filter),
        query_images_(flags.query_images.empty() ? flags.images : flags.query_images),
        estimator_options_(estimator_options),
        estimator_(MakePoseEstimator(estimator_options)),
        queries_(ReadQueryList(flags.queries)),
        quick_doctor_(queries_) {
    if (flags.RendersReferences()) {
      OpenGeometry();
      RenderModel();
      LoadModel();
    } else {
      LoadModel();
      OpenGeometry();
    }
    if (geometry_options.candidates.mode == CandidateMode::kTriangulate && !geometry_.empty()) {
      Take({"--candidates triangulate lifts nothing: --geometry is not used for points"});
    }
    RequireWritable(flags.out / "poses.txt");
    if (!flags.report.empty()) {
      RequireWritable(flags.report / "index.html");
      report_ = std::make_unique<LocalizationReport>(queries_.size(), query_images_);
    }
    if (!flags.write_problems.empty()) {
      RequireWritable(flags.write_problems / "problem.json");
    }
    match_source_ = OpenMatches();
    PrepareRerender(estimator_options);
    AlignGeometry();
    for (const NamedGeometry& geometry : geometry_) sources_.push_back(geometry.source.get());
    if (filter_.mode == FilterMode::kAuto &&
        geometry_options.candidates.mode != CandidateMode::kTriangulate) {
      filter_.scene_noise = EstimateSceneNoise(queries_, Parts(), flags.run.threads);
    }
  }

  void Run(const std::string& options_json) {
    const auto start = std::chrono::steady_clock::now();
    const std::vector<LocalizedQuery> localized =
        flags_.continuous.enabled ? LocalizeInOrder(options_json) : LocalizeAll();
    Take(match_source_->Warnings());
    CheckInput();
    PrintWarnings(warnings_);
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
    WritePoses(flags_.out / "poses.txt", localized);
    if (!flags_.continuous.enabled) {
      WriteQueryDiagnostics(flags_.out / "queries.jsonl", localized);
    }
    WriteFile(flags_.out / "options.json", options_json);
    if (report_) {
      WriteFile(flags_.report / "index.html",
                report_->Format("Raylift: " + flags_.out.string(), references_.images));
    }
    WriteSummary(flags_.out / "summary.json", localized,
                 {.num_references = references_.images.size(),
                  .geometry = used_geometry_,
                  .warnings = warnings_,
                  .seconds = elapsed.count()});
    if (!flags_.run.quiet) {
      Print(localized);
    }
  }

 private:
  void Take(std::vector<std::string> warnings) {
    warnings_.insert(warnings_.end(), warnings.begin(), warnings.end());
  }

  void LoadModel() {
    LoadedReferences loaded = LoadReferences(model_, flags_.references.thinning, model_poses_);
    references_ = std::move(loaded.references);
    covisibility_ = std::move(loaded.covisibility);
    Take(std::move(loaded.warnings));
  }

  // The references, from the mesh alone.
  void RenderModel() {
    std::vector<Camera> cameras;
    for (const Query& query : queries_) cameras.push_back(query.camera);
    const RenderedReferences rendered = RenderReferencesWithProgress(
        mesh_, flags_.mesh_only.Resolve(cameras, flags_.out / "references"), flags_.run.Show());
    Take(rendered.warnings);
    model_ = rendered.model;
    images_ = rendered.images;
    model_poses_ = PoseConvention::kCamFromWorld;
    if (!flags_.run.quiet) {
      fmt::print("references: {} views of the mesh ({}), {} rendered now: {}\n", rendered.count,
                 ToString(rendered.kind), rendered.rendered, rendered.images.string());
    }
  }

  void OpenGeometry() {
    for (const std::string& spec : flags_.geometry.specs) {
      NamedGeometry geometry = MakeGeometrySource(spec, {.model = model_,
                                                         .references = references_.images,
                                                         .thinned_out = references_.thinned_out});
      Take(std::move(geometry.warnings));
      used_geometry_.push_back({spec, geometry.understood, std::nullopt});
      if (mesh_ == nullptr) mesh_ = geometry.mesh;
      geometry_.push_back(std::move(geometry));
    }
  }

  // None by VLAD, which is the front end's own.
  std::optional<RetrievedLists> Retrieve() {
    RetrievalOptions options =
        flags_.retrieval.Resolve(flags_.geometry.specs, RetrievalFlags::Queries::kOwn);
    if (options.method == RetrievalMethod::kVlad) return std::nullopt;
    options.top_k = flags_.hloc.top_k;
    options.mesh = mesh_;
    options.threads = flags_.run.threads;
    options.show_progress = !flags_.run.quiet;
    flags_.retrieval.ReadPriorPoses(&options);
    Retrieval retrieval = RetrieveReferences(queries_, references_.images, options);
    Take(std::move(retrieval.warnings));
    return std::move(retrieval.lists);
  }

  std::unique_ptr<MatchSource> OpenMatches() {
    std::optional<int> max_joined;
    if (flags_.continuous.enabled) max_joined = flags_.continuous.MaxJoined(flags_.hloc.top_k);
    if (flags_.hloc.All()) {
      JoiningQueries joining;
      if (max_joined) joining = {queries_, *max_joined};
      return OpenHlocMatches(flags_.hloc.files, references_, flags_.hloc.top_k, joining);
    }
    FrontEndOptions options = flags_.front_end.Resolve(flags_.out / "cache");
    options.reference_images = images_;
    options.query_images = query_images_;
    options.top_k = flags_.hloc.top_k;
    options.seed = estimator_options_.seed;
    options.threads = flags_.run.threads;
    options.show_progress = !flags_.run.quiet;
    options.retrieved = Retrieve();
    options.max_joined = max_joined;
    return MakeFrontEndMatches(options, references_, queries_);
  }

  void PrepareRerender(const EstimatorOptions& estimator) {
    if (flags_.mesh_only.rerender == 0) return;
    rerenderer_.emplace(
        mesh_, ColorsLikePhotographs(mesh_->mesh()), query_images_,
        RerenderOptions{.rounds = flags_.mesh_only.rerender,
                        .use_pairs = estimator.method == Method::kE5p1,
                        .max_features = flags_.front_end.max_features,
                        .reprojection_threshold_px = estimator.reprojection_threshold_px});
  }

  // Each source by itself; the points of an SfM model agree with the references as they are.
  void AlignGeometry() {
    if (geometry_options_.align == AlignMode::kOff) return;
    const auto matches =
        CollectReferenceMatches(queries_, *match_source_, references_, flags_.run.threads);
    for (size_t i = 0; i < geometry_.size(); ++i) {
      NamedGeometry& geometry = geometry_[i];
      if (geometry.kind == GeometryKind::kSfm) continue;
      auto& alignment = used_geometry_[i].alignment;
      alignment = AlignDepth(*geometry.source, references_.images, matches,
                             {.mode = geometry_options_.align}, flags_.run.threads);
      geometry.source =
          std::make_unique<AlignedSource>(std::move(geometry.source), alignment->Corrections());
    }
    WriteAlignment(flags_.out / "depth_alignment.jsonl", used_geometry_);
  }

  void CheckInput() {
    if (flags_.no_doctor) return;
    for (const NamedGeometry& geometry : geometry_) {
      if (auto warning =
              quick_doctor_.Warn(geometry, references_, model_poses_, flags_.run.threads)) {
        Take({*warning});
      }
    }
  }

  LocalizerParts Parts() const {
    return {.match_source = growing_ ? growing_->matches() : *match_source_,
            .covisibility = covisibility_,
            .geometry = growing_ ? growing_->geometry() : sources_,
            .geometry_mode = geometry_options_.mode,
            .filter = filter_,
            .candidates = geometry_options_.candidates,
            .estimator = *estimator_};
  }

  std::vector<LocalizedQuery> LocalizeAll() {
    std::vector<LocalizedQuery> localized(queries_.size());
    Progress progress("queries", queries_.size(), flags_.run.Show());
    ParallelFor(queries_.size(), flags_.run.threads, [&](size_t i) {
      QueryResult result = Localize(i);
      Show(i, result);
      localized[i] = std::move(result.localized);
      progress.Advance();
    });
    return localized;
  }

  // Also writes queries.jsonl, whose lines say which queries joined the references.
  std::vector<LocalizedQuery> LocalizeInOrder(const std::string& options_json) {
    const std::vector<size_t> order = flags_.continuous.Order(queries_, references_);
    const ContinuousCheckpoint checkpoint(
        flags_.out / "continuous", ContinuousRunKey(options_json, references_, queries_, order),
        flags_.continuous.resume);
    covisibility_ = {};  // which knows nothing of queries: estimators tell clusters by the matches
    growing_.emplace(*match_source_, sources_, !flags_.continuous.trust_joined);
    const SignalGuard signals;
    Progress progress("queries", queries_.size(), flags_.run.Show());
    const ContinuousRecords records =
        LocalizeContinuously(queries_, order, *growing_, checkpoint,
                             {.gate = flags_.continuous.Gate(),
                              .estimator = estimator_options_,
                              .threads = flags_.run.threads,
                              .stop = &SignalGuard::stop()},
                             {.localize = [this](size_t i) { return Localize(i); },
                              .on_done =
                                  [&](size_t i, const QueryResult* result) {
                                    if (result != nullptr) Show(i, *result);
                                    progress.Advance();
                                  }});
    if (const size_t left = CountMissing(records); left > 0) {
      throw Interrupted(
          fmt::format("stopped by a signal with {} queries left; --resume goes on", left));
    }
    WriteQueryDiagnostics(flags_.out / "queries.jsonl", records);
    std::vector<LocalizedQuery> localized;
    for (const auto& record : records) localized.push_back(record->localized);
    return localized;
  }

  QueryResult Localize(size_t index) {
    QueryResult result = LocalizeQuery(queries_[index], Parts());
    if (!flags_.no_doctor && quick_doctor_.Wants(index)) {
      quick_doctor_.Add(index, result.problem.references, result.problem.matches_2d2d);
    }
    if (rerenderer_) rerenderer_->Improve(queries_[index], *estimator_, result);
    return result;
  }

  // Writes what is to be seen of a query beside its pose.
  void Show(size_t index, const QueryResult& result) {
    if (!flags_.write_problems.empty()) {
      WritePoseProblem(FileOfQuery(flags_.write_problems, queries_[index].name, ".json"),
                       {result.problem, std::nullopt});
    }
    if (static_cast<int>(index) < flags_.pictures && result.localized.localized() &&
        mesh_ != nullptr) {
      const Image photograph = ReadImage(query_images_ / queries_[index].name, ImageChannels::kRgb);
      WriteImage(FileOfQuery(flags_.out / "pictures", queries_[index].name, ".jpg"),
                 DrawQueryPicture(result, photograph, *mesh_, 1));
    }
    if (report_) report_->Take(index, result);
  }

  void Print(const std::vector<LocalizedQuery>& localized) const {
    for (const UsedGeometry& used : used_geometry_) {
      if (!used.alignment) continue;
      fmt::print(
          "aligned {}: keypoints were {:.2f} px from their matches, now {:.2f} px (median)\n",
          used.spec, used.alignment->median_before_px, used.alignment->median_after_px);
    }
    size_t count = 0;
    for (const LocalizedQuery& query : localized) {
      count += query.localized() ? 1 : 0;
      if (!query.localized()) {
        fmt::print("not localized: {}: {}\n", query.name, query.reason);
      }
    }
    if (const RerenderCounts counts = CountRerendered(localized); counts.asked) {
      fmt::print("rendered again: {} poses sharpened in {} rounds\n", counts.improved,
                 counts.rounds_kept);
    }
    if (growing_) {
      fmt::print("{} localized queries joined the references\n", growing_->joined().size());
    }
    fmt::print("localized {} of {} queries against {} references: {}\n", count, localized.size(),
               references_.images.size(), (flags_.out / "poses.txt").string());
  }

  const LocalizeFlags& flags_;
  path model_, images_;  // of the references
  PoseConvention model_poses_;
  GeometryOptions geometry_options_;
  FilterOptions filter_;
  path query_images_;
  EstimatorOptions estimator_options_;
  std::unique_ptr<PoseEstimator> estimator_;
  std::vector<Query> queries_;
  QuickDoctor quick_doctor_;
  ReferenceSet references_;
  Covisibility covisibility_;
  std::vector<NamedGeometry> geometry_;
  std::vector<UsedGeometry> used_geometry_;     // one for each of geometry_
  std::vector<const GeometrySource*> sources_;  // of geometry_
  std::shared_ptr<const RayCaster> mesh_;       // for pictures; null where no source is a mesh
  std::vector<std::string> warnings_;
  std::unique_ptr<MatchSource> match_source_;
  std::optional<Rerenderer> rerenderer_;        // none where it is not asked for
  std::optional<GrowingScene> growing_;         // with --continuous, once localization starts
  std::unique_ptr<LocalizationReport> report_;  // null where none is asked for
};

}  // namespace

void RunLocalize(const LocalizeFlags& flags, const GeometryOptions& geometry,
                 const FilterOptions& filter, const EstimatorOptions& estimator,
                 const std::string& options_json) {
  LocalizeRun(flags, geometry, filter, estimator).Run(options_json);
}

}  // namespace raylift
