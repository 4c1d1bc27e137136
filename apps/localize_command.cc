// raylift localize: estimates the poses of query photographs in a scene. raylift prepare: makes
// beforehand what localize makes before its first query.

#include <algorithm>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/job_options.h"
#include "apps/localize_flags.h"
#include "apps/localize_inputs.h"
#include "apps/localize_output.h"
#include "apps/localize_remote.h"
#include "apps/options.h"
#include "base/hash.h"
#include "base/progress.h"
#include "jobs/file_promises.h"
#include "lifting/mesh_spec.h"
#include "localization/continuous/continuous_localizer.h"
#include "localization/results/query_job.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/localization/localize_all.h"
#include "raylift/localization/result_files.h"
#include "raylift/localization/scene_calibration.h"
#include "raylift/sequences/smooth_queries.h"
#include "raylift/sequences/walk.h"

namespace raylift {
namespace {

// Returns the header of the manifest, which says what the results depend on: JSON of the options
// that matter, and fingerprints of the inputs in place of their paths, so that another machine may
// resume the run.
std::string LocalizeHeader(const LocalizeFlags& flags, const std::string& options_json,
                           const Scene& scene, std::span<const Query> queries) {
  auto options = nlohmann::ordered_json::parse(options_json);
  auto inputs = InputsJson({.model = flags.references.model,
                            .images = flags.images,
                            .query_images = flags.QueryImages(),
                            .out = flags.out,
                            .matching = flags.matching,
                            .threads = flags.run.threads},
                           scene, queries);
  if (flags.continuous.enabled) {
    const std::vector<size_t> order = flags.Order(queries, scene.references);
    inputs["order"] = HexText(HashBytes64(fmt::format("{}", fmt::join(order, " "))));
  }
  // Where they are written changes nothing, but whether they are must be the same for all queries.
  options["write-problems"] = !flags.write_problems.empty();
  options["report"] = !flags.report.empty();
  if (!flags.scene_calibration.empty()) {
    options["scene-calibration"] = HexText(HashBytes64(FormatSceneCalibration(*scene.calibration)));
  }
  return JobHeader(std::move(options), queries.size(),
                   {"scene", "model", "images", "queries", "priors", "rigs", "query-images",
                    "features", "matches", "pairs", "cache", "prior-poses", "global-features",
                    "query-global-features", "write-model",
                    // Walks are smoothed after all.
                    "odometry", "cam-from-body", "odometry-scale", "online", "no-rematch", "times",
                    // It is for the page alone.
                    "ground-truth"},
                   inputs);
}

// Returns the options of results, with the system of the world where the geometry's files alone
// name it, for those who read the results.
std::string OptionsWithWorld(const std::string& options_json,
                             const std::optional<WorldFrame>& world) {
  auto options = nlohmann::ordered_json::parse(options_json);
  if (world) options["crs"] = world->text;
  return OptionsOfResults(options.dump());
}

// The walks of --odometry are read before the work and smoothed after it.

std::vector<Walk> OpenWalks(const LocalizeFlags& flags, std::span<const Query> queries) {
  return ReadWalks(flags.walk.odometry, flags.times, NamesOf(queries), flags.walk.cam_from_body);
}

// Returns whether photographs are localized again where their walk predicts them.
bool Rematches(const LocalizeFlags& flags) {
  return flags.walk.enabled() && !flags.walk.no_rematch && !flags.walk.online &&
         !flags.estimator.refine_focal;
}

// Smooths the records of all queries, which then tell their poses in the walks. `open_localizer`
// is called where photographs are to be localized again.
WalkedQueries SmoothRecords(const LocalizeFlags& flags, std::span<const Walk> walks,
                            const Scene& scene, std::span<const Query> queries,
                            const std::function<const LocalizeAll&()>& open_localizer,
                            std::vector<QueryRecord>& records) {
  SmoothingOptions options{.scale = flags.walk.scale,
                           .min_confidence = flags.min_confidence,
                           .online = flags.walk.online,
                           .threads = flags.run.threads};
  if (Rematches(flags)) {
    options.open_localizer = [&]() -> LocalizeAgain {
      return std::bind_front(&LocalizeAll::LocalizeAgain, &open_localizer());
    };
  }
  std::vector<LocalizedQuery> alone;
  for (QueryRecord& record : records) alone.push_back(std::move(record.localized));
  WalkedQueries walked =
      SmoothQueries(alone, queries, walks, SceneDistances(scene, flags.run.threads), options);
  for (size_t i = 0; i < records.size(); ++i) {
    records[i].localized = walked.queries[i].localized;
    records[i].diagnostics = FormatQueryDiagnostics(walked.queries[i]);
  }
  return walked;
}

// Prints the walk's summary on stdout.
void PrintWalk(const WalkedQueries& walked) {
  fmt::print("walk: {} poses smoothed, {} rescued, {} replaced, {} dropped",
             walked.Count(WalkRole::kSmoothed), walked.Count(WalkRole::kRescued),
             walked.Count(WalkRole::kReplaced), walked.Count(WalkRole::kDropped));
  if (const size_t disputed = walked.Count(WalkRole::kDisputed); disputed > 0) {
    fmt::print(", {} disputed", disputed);
  }
  const auto rematched = std::ranges::count_if(walked.queries, &WalkedQuery::rematched);
  if (rematched > 0) fmt::print("; {} found again where the walk predicts them", rematched);
  for (const auto& [folder, queries, odometry] : walked.walks) {
    if (!odometry) continue;
    fmt::print("; {}odometry's scale {:.4g}, noise of a step {:.2g} and {:.2g} degrees",
               folder.empty() ? "" : folder + ": ", odometry->scale, odometry->step_sigma,
               odometry->step_rotation_sigma_deg);
  }
  fmt::print("\n");
}

// The work of one command. A signal ends what comes before the first query.
class LocalizeRun {
 public:
  LocalizeRun(const LocalizeFlags& flags, LocalizeAllOptions options,
              const std::string& options_json)
      : flags_(flags), options_(std::move(options)), options_json_(options_json) {
    RefuseFormerRun(flags.running.In(flags.out), QueryJobForm(flags.out));
    UntilSignal([this] {
      LocalizeInputs inputs = OpenLocalizeInputs(flags_);
      scene_ = std::move(inputs.scene);
      queries_ = std::move(inputs.queries);
      options_of_results_ = OptionsWithWorld(options_json_, inputs.world);
      if (flags_.walk.enabled()) walks_ = OpenWalks(flags_, queries_);
    });
    times_.reading = clock_.Lap();
    warnings_ = scene_.warnings;
    const CandidateOptions& candidates = options_.localizer.candidates;
    if (candidates.mode == CandidateMode::kTriangulate && !scene_.sources.empty()) {
      warnings_.emplace_back(
          "--candidates triangulate lifts nothing: --geometry is not used for points");
    }
    output_ = std::make_unique<LocalizeOutput>(flags, queries_.size(), scene_.Surface());
  }

  void Run() {
    QueryJob job(queries_, LocalizeHeader(flags_, options_json_, scene_, queries_),
                 flags_.running.In(flags_.out));
    const std::vector<size_t> missing = job.Missing();
    if (!missing.empty() || !job.facts()) {
      RunFacts facts;
      UntilSignal([&] {
        if (job.facts()) TakeCalibration(*job.facts());
        localizer_ = OpenLocalizer(flags_, scene_, queries_, options_);
        times_.matching = clock_.Lap();
        facts = FactsOf(*localizer_, job.facts());
        times_.learning = clock_.Lap();
      });
      job.Begin(facts);
      WriteFile(flags_.out / "options.json", options_of_results_);
      Localize(*localizer_, missing, job);
      times_.queries = clock_.Lap();
      times_.writing = output_->ShowSeconds();
      scene_ = localizer_->scene();
      if (!Rematches(flags_)) localizer_.reset();
    }
    Finish(job, missing.size());
  }

 private:
  // Takes the calibration that a former run has found, unless another one is given.
  void TakeCalibration(const RunFacts& facts) {
    if (scene_.calibration != nullptr) return;
    scene_ = Calibrated(scene_, std::make_shared<const SceneCalibration>(facts.calibration));
  }

  // Returns the facts of this run; `known` are those of a former one.
  RunFacts FactsOf(LocalizeAll& localizer, const std::optional<RunFacts>& known) {
    localizer.Calibrate();
    const Scene& scene = localizer.scene();
    const CommittedFiles written;
    for (std::string& warning : WriteCalibration(flags_, scene, options_.localizer.estimator)) {
      warnings_.push_back(std::move(warning));
    }
    return {.num_references = scene.references.images.size(),
            .geometry = SummaryOf(scene.sources),
            .warnings = warnings_,
            .checks_geometry = localizer.ChecksGeometry(),
            .calibration = *scene.calibration,
            .input_warnings = known
                                  ? known->input_warnings
                                  : InputOrDepthWarnings(flags_, localizer.InputWarnings(), scene),
            .files = PromiseFiles(flags_.out, written.paths())};
  }

  void Localize(LocalizeAll& localizer, const std::vector<size_t>& missing, QueryJob& job) {
    Progress progress("queries", missing.size(), flags_.run.Show());
    const auto add = [&](size_t i, const QueryResult& result, const JoinDecision& decision) {
      job.Add(i, {.localized = result.localized,
                  .diagnostics = decision.diagnostics,
                  .warnings = localizer.MatchWarnings(),
                  .log_focal_factor = localizer.LogFocalFactor(i),
                  .joined = decision.joined,
                  .files = PromiseFiles(flags_.out, output_->Show(i, result))});
      progress.Advance();
    };
    if (flags_.continuous.enabled) {
      const std::vector<size_t> order = flags_.Order(queries_, localizer.scene().references);
      localizer.RunContinuously({.order = order,
                                 .done = job.Joined(),
                                 .gate = flags_.continuous.Gate(),
                                 .weigh = !flags_.continuous.trust_joined,
                                 .stop = &SignalGuard::stop(),
                                 .on_done = add});
    } else {
      localizer.Run(
          missing,
          [&](size_t i, const QueryResult& result) {
            add(i, result, {.diagnostics = FormatQueryDiagnostics(result.localized)});
          },
          &SignalGuard::stop());
    }
    RequireNoneLeft(job.Missing().size(), "queries");
  }

  void Finish(QueryJob& job, size_t done) {
    const Shard shard = flags_.running.Resolve();
    auto records = job.Whole();
    if (!shard.IsAll() && !flags_.run.quiet) {
      fmt::print("shard {}/{} of {} queries: {} localized now{}\n", shard.index, shard.count,
                 queries_.size(), done, records ? "; all shards are complete" : "");
    }
    if (!records) return;
    RunFacts facts = *job.facts();
    const std::optional<WalkedQueries> walked = Smooth(facts, *records);
    if (walked) {
      facts.warnings.insert(facts.warnings.end(), walked->warnings.begin(), walked->warnings.end());
    }
    const std::vector<std::string> warnings = AllWarnings(facts, *records);
    PrintWarnings(warnings);
    PrintWarnings(job.machine_warnings());
    const CommittedFiles results;
    WriteResults(flags_.out, facts, *records, times_);
    if (walked) {
      WriteWalk(flags_.out, *walked);
    } else {
      RemoveWalk(flags_.out);
    }
    std::vector<LocalizedQuery> localized;
    size_t joined = 0;
    for (const QueryRecord& record : *records) {
      localized.push_back(record.localized);
      joined += record.joined ? 1 : 0;
    }
    output_->Finish(localized,
                    {.scene = scene_,
                     .queries = queries_,
                     .warnings = warnings,
                     .times = times_,
                     .joined = joined,
                     .walked = walked ? &*walked : nullptr},
                    options_of_results_);
    job.Finish(results.paths());
    if (walked && !flags_.run.quiet) PrintWalk(*walked);
  }

  // Smooths the walks; nullopt where no odometry is given.
  std::optional<WalkedQueries> Smooth(const RunFacts& facts, std::vector<QueryRecord>& records) {
    if (walks_.empty()) return std::nullopt;
    TakeCalibration(facts);
    const auto open_localizer = [&]() -> const LocalizeAll& {
      if (localizer_ == nullptr) {
        localizer_ = OpenLocalizer(flags_, scene_, queries_, options_);
        localizer_->Calibrate();
      }
      return *localizer_;
    };
    std::optional<WalkedQueries> walked;
    UntilSignal(
        [&] { walked = SmoothRecords(flags_, walks_, scene_, queries_, open_localizer, records); },
        [] { return "stopped by a signal; --resume goes on"; });
    localizer_.reset();
    return walked;
  }

  const LocalizeFlags& flags_;
  LocalizeAllOptions options_;
  const std::string& options_json_;
  std::string options_of_results_;
  std::vector<Query> queries_;
  std::vector<Walk> walks_;
  Scene scene_;
  std::unique_ptr<LocalizeAll> localizer_;  // null where a former run has localized all queries
  std::vector<std::string> warnings_;
  std::unique_ptr<LocalizeOutput> output_;
  LapClock clock_;
  RunTimes times_;
};

// Makes beforehand what localize would make before its first query (raylift prepare).
void Prepare(const LocalizeFlags& flags) {
  flags.Check();
  FeatureCount features;
  const auto prepare = [&] {
    const LocalizeInputs inputs = OpenLocalizeInputs(flags);
    PrintWarnings(inputs.scene.warnings);
    features = PrepareFeatures(flags, inputs, flags.estimator.seed);
  };
  UntilSignal(prepare, [] { return "stopped by a signal; the same command goes on"; });
  if (flags.run.quiet) return;
  if (flags.matching.hloc.Any()) {
    fmt::print("features and matches are given: nothing to extract\n");
    return;
  }
  fmt::print("features of {} images: {} extracted now, {} missing\n", features.images,
             features.extracted, features.missing);
}

}  // namespace

Command AddLocalizeCommand(CLI::App& program) {
  auto flags = std::make_shared<LocalizeFlags>();
  CLI::App& command =
      AddCommand(program, "localize", "Poses of query photographs in a known scene");
  AddLocalizeOptions(command, *flags);
  auto remote = std::make_shared<RemoteFlags>();
  AddRemoteOptions(command, *remote);
  return {&command, [flags, remote, &command] {
            if (remote->server) return LocalizeRemotely(*remote, *flags);
            if (!remote->token_file.empty()) throw OptionError("--token-file needs --server");
            flags->geometry.specs = InWorld(flags->geometry.specs, flags->world);
            flags->Check();
            LocalizeRun(*flags,
                        {.localizer = flags->Localizer(),
                         .align = flags->geometry.align,
                         .check_input = !flags->no_doctor,
                         .one_by_one = flags->continuous.enabled,
                         .threads = flags->run.threads},
                        EffectiveOptionsJson(command))
                .Run();
          }};
}

Command AddPrepareCommand(CLI::App& program) {
  auto flags = std::make_shared<LocalizeFlags>();
  CLI::App& command = AddCommand(program, "prepare",
                                 "Features and rendered references of localize, made beforehand");
  AddLocalizeOptions(command, *flags);
  SetFooter(
      command,
      R"(Takes the arguments of localize, which then finds what was made; what was there is kept. A
signal ends it in good order (exit code 4), and the same command goes on. Shards share the
photographs; references that are rendered from a mesh are made by one of them, and the others
wait. localize alone makes the same, and its shards wait for the first of them.
Example:
  raylift prepare --scene scene.toml --out result --shard 1/2
  raylift prepare --scene scene.toml --out result --shard 2/2
  raylift localize --scene scene.toml --out result)");
  return {&command, [flags] {
            flags->geometry.specs = InWorld(flags->geometry.specs, flags->world);
            Prepare(*flags);
          }};
}

}  // namespace raylift
