#include "localize_run.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>

#include "interrupt.h"
#include "localize_header.h"
#include "localize_output.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/progress.h"
#include "raylift/io/pose_prior_list.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/batch_localizer.h"
#include "raylift/localization/matching.h"
#include "raylift/localization/query_job.h"
#include "raylift/localization/result_files.h"

namespace raylift {
namespace {

// The references, from a model or from the mesh alone.
Scene OpenSceneOf(const LocalizeFlags& flags, std::span<const Query> queries) {
  if (!flags.RendersReferences()) {
    return OpenScene({.model = flags.references.model,
                      .model_poses = flags.model_poses.Resolve(),
                      .thinning = flags.references.thinning,
                      .images = flags.images,
                      .geometry = flags.geometry.specs,
                      .threads = flags.run.threads});
  }
  std::vector<Camera> cameras;
  for (const Query& query : queries) cameras.push_back(query.camera);
  RenderedReferenceOptions rendering = flags.mesh_only.Resolve(cameras, flags.out / "references");
  rendering.threads = flags.run.threads;
  Scene scene = RenderSceneWithProgress(flags.geometry.specs.front(), flags.references.thinning,
                                        rendering, flags.run.Show());
  if (!flags.run.quiet) {
    const RenderedReferences& rendered = *scene.rendered;
    fmt::print("references: {} views of the mesh ({}), {} rendered now: {}\n", rendered.count,
               ToString(rendered.kind), rendered.rendered, rendered.images.string());
  }
  return scene;
}

MatchingOptions MatchingOf(const LocalizeFlags& flags, uint64_t seed) {
  MatchingOptions matching = flags.matching.Resolve(flags.geometry.specs, flags.QueryImages(),
                                                    flags.out / "cache", seed, flags.run);
  if (flags.continuous.enabled) matching.max_joined = flags.continuous.MaxJoined(matching.top_k);
  return matching;
}

std::shared_ptr<const Rerenderer> RerendererOf(const LocalizeFlags& flags, const Scene& scene,
                                               const EstimatorOptions& estimator) {
  if (flags.mesh_only.rerender == 0) return nullptr;
  const auto mesh = scene.Mesh();
  return std::make_shared<const Rerenderer>(
      mesh, ColorsLikePhotographs(mesh->mesh()), flags.QueryImages(),
      RerenderOptions{.rounds = flags.mesh_only.rerender,
                      .use_pairs = ScoresPairsAlone(estimator.method),
                      .max_features = flags.matching.front_end.max_features,
                      .reprojection_threshold_px = estimator.reprojection_threshold_px});
}

// Also writes queries.jsonl, whose lines say which queries joined the references.
ContinuousRecords LocalizeInOrder(const LocalizeFlags& flags, BatchLocalizer& localizer,
                                  LocalizeOutput& output, const std::string& options_json) {
  const ReferenceSet& references = localizer.scene().references;
  const std::vector<size_t> order = flags.continuous.Order(localizer.queries(), references);
  const ContinuousCheckpoint checkpoint(
      flags.out / "continuous",
      ContinuousRunKey(options_json, references, localizer.queries(), order), flags.running.resume);
  Progress progress("queries", order.size(), flags.run.Show());
  ContinuousRecords records =
      localizer.LocalizeContinuously({.order = order,
                                      .checkpoint = checkpoint,
                                      .gate = flags.continuous.Gate(),
                                      .weigh = !flags.continuous.trust_joined,
                                      .stop = &SignalGuard::stop(),
                                      .on_done = [&](size_t i, const QueryResult* result) {
                                        if (result != nullptr) output.Show(i, *result);
                                        progress.Advance();
                                      }});
  if (const size_t left = CountMissing(records); left > 0) {
    throw Interrupted(
        fmt::format("stopped by a signal with {} queries left; --resume goes on", left));
  }
  WriteQueryDiagnostics(flags.out / "queries.jsonl", records);
  return records;
}

// A folder holds a run with --continuous or one without it.
void RefuseOtherMode(const LocalizeFlags& flags) {
  const std::filesystem::path checkpoint = flags.out / "continuous";
  const std::vector<std::filesystem::path> manifests = ListManifests(flags.out);
  const bool continuous = flags.continuous.enabled;
  std::error_code ignored;
  const bool other_is_there =
      continuous ? !manifests.empty() : std::filesystem::exists(checkpoint, ignored);
  if (!other_is_there) return;
  if (!flags.running.overwrite) {
    throw OptionError("--out", flags.out.string(),
                      fmt::format("holds a former run {} --continuous; --overwrite removes it",
                                  continuous ? "without" : "with"));
  }
  std::filesystem::remove_all(checkpoint, ignored);
  for (const auto& manifest : manifests) std::filesystem::remove(manifest, ignored);
}

// A scene with its matches, ready to localize.
std::unique_ptr<BatchLocalizer> OpenLocalizer(const LocalizeFlags& flags, const Scene& scene,
                                              std::span<const Query> queries,
                                              BatchOptions options) {
  auto matches = OpenMatches(scene, queries, MatchingOf(flags, options.localizer.estimator.seed));
  options.rerenderer = RerendererOf(flags, scene, options.localizer.estimator);
  auto localizer = std::make_unique<BatchLocalizer>(
      scene, std::vector<Query>(queries.begin(), queries.end()), std::move(matches), options);
  const auto& sources = localizer->scene().sources;
  if (std::any_of(sources.begin(), sources.end(), [](const SceneSource& source) {
        return source.alignment && source.alignment->mode != AlignMode::kOff;
      })) {
    WriteAlignment(flags.out / "depth_alignment.jsonl", sources);
  }
  return localizer;
}

// One command's work. A signal ends what comes before the first query.
class LocalizeRun {
 public:
  LocalizeRun(const LocalizeFlags& flags, BatchOptions options, const std::string& options_json)
      : flags_(flags), options_(std::move(options)), options_json_(options_json) {
    RefuseOtherMode(flags);
    RefuseFormerRun(JobOptions());
    queries_ = ReadQueryList(flags.queries, flags.QueryImages());
    if (!flags.priors.empty()) TakePosePriors(flags.priors, queries_);
    UntilSignal([this] { scene_ = OpenSceneOf(flags_, queries_); });
    warnings_ = scene_.warnings;
    const CandidateOptions& candidates = options_.localizer.candidates;
    if (candidates.mode == CandidateMode::kTriangulate && !scene_.sources.empty()) {
      warnings_.emplace_back(
          "--candidates triangulate lifts nothing: --geometry is not used for points");
    }
    output_ = std::make_unique<LocalizeOutput>(flags, queries_.size(), scene_.Surface());
  }

  void Run() {
    if (flags_.continuous.enabled) {
      RunContinuously();
    } else {
      RunAsJob();
    }
  }

 private:
  QueryJobOptions JobOptions() const {
    return {.out = flags_.out,
            .shard = flags_.running.Resolve(),
            .resume = flags_.running.resume,
            .overwrite = flags_.running.overwrite};
  }

  double Seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

  void RunContinuously() {
    std::unique_ptr<BatchLocalizer> localizer;
    UntilSignal([&] { localizer = OpenLocalizer(flags_, scene_, queries_, options_); });
    start_ = std::chrono::steady_clock::now();
    std::vector<LocalizedQuery> localized;
    size_t joined = 0;
    for (auto& record : LocalizeInOrder(flags_, *localizer, *output_, options_json_)) {
      joined += record->joined ? 1 : 0;
      localized.push_back(std::move(record->localized));
    }
    for (std::string& warning : localizer->ContinuousWarnings(localized)) {
      warnings_.push_back(std::move(warning));
    }
    PrintWarnings(warnings_);
    const Scene& scene = localizer->scene();
    WritePoses(flags_.out / "poses.txt", localized);
    WriteSummary(flags_.out / "summary.json", localized,
                 {.num_references = scene.references.images.size(),
                  .geometry = SummaryOf(scene.sources),
                  .warnings = warnings_,
                  .seconds = Seconds()});
    output_->Finish(localized, {scene, queries_, joined}, OptionsOfResults(options_json_));
  }

  void RunAsJob() {
    QueryJob job(queries_, LocalizeHeader(flags_, options_json_, scene_, queries_), JobOptions());
    const std::vector<size_t> missing = job.Missing();
    if (!missing.empty() || !job.facts()) {
      std::unique_ptr<BatchLocalizer> localizer;
      UntilSignal([&] {
        if (job.facts()) options_.knowledge = job.facts()->knowledge;
        localizer = OpenLocalizer(flags_, scene_, queries_, options_);
        start_ = std::chrono::steady_clock::now();
        localizer->Learn();
      });
      job.Begin(FactsOf(*localizer));
      WriteFile(flags_.out / "options.json", OptionsOfResults(options_json_));
      Localize(*localizer, missing, job);
      scene_ = localizer->scene();
    }
    Finish(job, missing.size());
  }

  RunFacts FactsOf(BatchLocalizer& localizer) const {
    const Scene& scene = localizer.scene();
    return {.num_references = scene.references.images.size(),
            .geometry = SummaryOf(scene.sources),
            .warnings = warnings_,
            .checks_geometry = localizer.ChecksGeometry(),
            .knowledge = localizer.Learn()};
  }

  void Localize(BatchLocalizer& localizer, const std::vector<size_t>& missing, QueryJob& job) {
    Progress progress("queries", missing.size(), flags_.run.Show());
    localizer.Localize(
        missing,
        [&](size_t i, const QueryResult& result) {
          output_->Show(i, result);
          job.Add(i, result.localized, localizer.MatchWarnings(), localizer.LogFocalFactor(i));
          progress.Advance();
        },
        &SignalGuard::stop());
    if (const size_t left = job.Missing().size(); left > 0) {
      throw Interrupted(
          fmt::format("stopped by a signal with {} queries left; --resume goes on", left));
    }
  }

  void Finish(QueryJob& job, size_t done) {
    const Shard shard = flags_.running.Resolve();
    const auto records = job.Finish();
    if (!shard.IsAll() && !flags_.run.quiet) {
      fmt::print("shard {}/{} of {} queries: {} localized now{}\n", shard.index, shard.count,
                 queries_.size(), done, records ? "; all shards are complete" : "");
    }
    if (!records) return;
    PrintWarnings(AllWarnings(*job.facts(), *records));
    WriteResults(flags_.out, *job.facts(), *records, Seconds());
    std::vector<LocalizedQuery> localized;
    for (const QueryRecord& record : *records) localized.push_back(record.localized);
    output_->Finish(localized, {scene_, queries_}, OptionsOfResults(options_json_));
  }

  const SignalGuard signals_;
  const LocalizeFlags& flags_;
  BatchOptions options_;
  const std::string& options_json_;
  std::vector<Query> queries_;
  Scene scene_;
  std::vector<std::string> warnings_;
  std::unique_ptr<LocalizeOutput> output_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace

void RunLocalize(const LocalizeFlags& flags, const LocalizerOptions& options, AlignMode align,
                 const std::string& options_json) {
  LocalizeRun(flags,
              {.localizer = options,
               .align = align,
               .check_input = !flags.no_doctor,
               .threads = flags.run.threads},
              options_json)
      .Run();
}

}  // namespace raylift
