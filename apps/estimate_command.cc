// raylift estimate: estimates the poses of pose problems, which needs no geometry.

#include <algorithm>
#include <atomic>
#include <memory>
#include <numeric>
#include <optional>
#include <set>

#include "apps/commands.h"
#include "apps/estimate_results.h"
#include "apps/interrupt.h"
#include "apps/job_options.h"
#include "apps/options.h"
#include "base/hash.h"
#include "base/input_paths.h"
#include "base/lap_clock.h"
#include "base/progress.h"
#include "jobs/fingerprint.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/io/pose_problem_json.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/scene_calibration.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct EstimateFlags {
  std::vector<path> problems;
  path csv, json, poses, out;
  path scene_calibration;  // empty: the problems tell
  int repeat = 1;
  bool independent = false;
  FilterOptions filter;
  EstimatorOptions estimator;
  RunFlags run;
  JobFlags running;

  // Throws OptionError for what the options alone can tell.
  void Check() const {
    RequireAtLeast("--repeat", repeat, 1);
    run.Check();
    running.Check();
    const bool is_job = running.resume || running.overwrite || !running.Resolve().IsAll();
    if (out.empty() && is_job) {
      throw OptionError("--resume, --overwrite and --shard need --out, where results are kept");
    }
    for (const path& folder : problems) RefuseOutBelow(folder);
  }

 private:
  // Refuses --out below the folder of problems: its results would be problems, too, the next time.
  void RefuseOutBelow(const path& folder) const {
    if (out.empty() || !IsFolder(folder)) return;
    const path whole = std::filesystem::weakly_canonical(out);
    if (!Below(whole, std::filesystem::canonical(folder))) return;
    throw OptionError("--out", out.string(),
                      fmt::format("lies in the folder of the problems, {}", folder.string()));
  }
};

struct ProblemFile {
  path file;
  std::string name;  // below the folder, where one alone was given
};

std::vector<ProblemFile> ListAll(const std::vector<path>& files_or_folders) {
  std::vector<ProblemFile> files;
  for (const path& entry : files_or_folders) {
    for (const path& file : ListPoseProblems(entry)) {
      const bool is_below = files_or_folders.size() == 1 && file != entry;
      files.push_back({file, is_below ? file.lexically_relative(entry).string() : file.string()});
    }
  }
  return files;
}

PoseProblem ReadFiltered(const path& file, const FilterOptions& filter) {
  PoseProblem problem = ReadPoseProblem(file).problem;
  FilterProblem(filter, problem);
  return problem;
}

// Learns the noise that some 30 of the problems have in common, the same ones whatever their order.
std::optional<SceneNoise> LearnSceneNoise(std::vector<ProblemFile> files,
                                          const EstimateFlags& flags, const FilterOptions& filter,
                                          const EstimatorOptions& options) {
  if (flags.independent) return std::nullopt;
  std::sort(files.begin(), files.end(),
            [](const ProblemFile& a, const ProblemFile& b) { return a.file < b.file; });
  return raylift::LearnSceneNoise(
      files.size(), [&](size_t i) { return ReadFiltered(files[i].file, filter); }, options,
      flags.run.threads);
}

// Returns the estimate, and the median time of `repeat` runs, which all give the same estimate.
EstimateRow Estimate(const PoseEstimator& estimator, Method method, const ProblemFile& file,
                     const FilterOptions& filter, int repeat) {
  const PoseProblem problem = ReadFiltered(file.file, filter);
  PoseEstimate estimate;
  std::vector<double> times_ms;
  for (int i = 0; i < repeat; ++i) {
    const LapClock clock;
    estimate = estimator.Estimate(problem);
    times_ms.push_back(1e3 * clock.Seconds());
  }
  std::sort(times_ms.begin(), times_ms.end());
  return MakeEstimateRow(problem.name, file.name, method, estimate, times_ms[times_ms.size() / 2]);
}

// The work of one command; with --out, it is a job.
class EstimateRun {
 public:
  EstimateRun(const EstimateFlags& flags, const std::string& options_json)
      : flags_(flags),
        options_json_(options_json),
        options_(flags.estimator),
        filter_(flags.filter) {
    options_.Validate();
    filter_.thresholds.Validate();
    filter_.few_points = FewPointsFor(options_.method);
    flags.Check();
    if (!flags.scene_calibration.empty()) TakeCalibration();
    for (const path& output : {flags.csv, flags.json, flags.poses}) {
      if (!output.empty()) RequireWritable(output);
    }
    if (!flags.out.empty()) RefuseFormerRun(flags.running.In(flags.out), EstimateJobForm());
    files_ = ListAll(flags.problems);
  }

  void Run() {
    if (flags_.out.empty()) {
      rows_.resize(files_.size());
      std::vector<size_t> all(files_.size());
      std::iota(all.begin(), all.end(), size_t{0});
      const size_t left =
          Estimate(all, [this](size_t i, EstimateRow row) { rows_[i] = std::move(row); });
      if (left > 0) {
        throw Interrupted(fmt::format(
            "stopped by a signal with {} problems left; --out keeps what is done", left));
      }
    } else if (!RunAsJob()) {
      return;
    }
    if (!flags_.csv.empty()) WriteFile(flags_.csv, FormatEstimatesCsv(rows_));
    if (!flags_.json.empty()) WriteFile(flags_.json, FormatEstimatesJson(rows_));
    if (!flags_.poses.empty()) WriteEstimatedPoses(flags_.poses, rows_);
    if (!flags_.run.quiet) PrintEstimates(rows_);
  }

 private:
  // Takes the options that a localizer makes of a scene's calibration; the problems' depth is
  // corrected already.
  void TakeCalibration() {
    Scene scene;
    scene.calibration = ReadSceneCalibration(flags_.scene_calibration);
    const Localizer knowing(std::make_shared<const Scene>(std::move(scene)), nullptr,
                            {.estimator = options_, .filter = filter_});
    options_ = knowing.options().estimator;
    filter_ = knowing.options().filter;
  }

  // Returns whether all shards are done.
  bool RunAsJob() {
    const std::vector<std::string> names = Names();
    const JobFolder folder = flags_.running.In(flags_.out);
    std::string header;
    UntilSignal([&] { header = Header(names); });
    TaskJob job(names, header, folder, EstimateJobForm());
    const std::vector<size_t> missing = job.Missing();
    if (!missing.empty()) {
      job.Begin(std::nullopt);
      WriteFile(flags_.out / "options.json", OptionsOfResults(options_json_));
      Estimate(missing, [&job](size_t i, const EstimateRow& row) {
        job.Add(i, EstimateLine(i, job.key(i), row));
      });
      RequireNoneLeft(job.Missing().size(), "problems");
    }
    const std::optional<TaskManifest> whole = job.Whole();
    if (!folder.shard.IsAll() && !flags_.run.quiet) {
      fmt::print("shard {}/{} of {} problems: {} estimated now{}\n", folder.shard.index,
                 folder.shard.count, names.size(), missing.size(),
                 whole ? "; all shards are complete" : "");
    }
    if (!whole) return false;
    PrintWarnings(MachineWarnings(*whole));
    rows_ = EstimateRowsOf(*whole);
    const CommittedFiles results;
    WriteEstimates(flags_.out, rows_);
    job.Finish(WithoutTimes(*whole), results.paths());
    return true;
  }

  // Returns the names of the tasks. Throws InputError where two files have the same name.
  std::vector<std::string> Names() const {
    std::vector<std::string> names;
    std::set<std::string> distinct;
    for (const ProblemFile& file : files_) {
      if (!distinct.insert(file.name).second) {
        throw InputError(file.file,
                         fmt::format("{} is there twice: --out needs distinct files", file.name));
      }
      names.push_back(file.name);
    }
    return names;
  }

  std::string Header(const std::vector<std::string>& names) const {
    std::vector<std::string> prints(files_.size());
    ParallelFor(files_.size(), flags_.run.threads,
                [&](size_t i) { prints[i] = FileFingerprint(files_[i].file); });
    std::string text;
    for (size_t i = 0; i < names.size(); ++i) text += names[i] + ' ' + prints[i] + '\n';
    nlohmann::ordered_json inputs = {
        {"problems", fmt::format("{} {}", names.size(), HexText(HashBytes64(text)))}};
    if (!flags_.scene_calibration.empty()) {
      inputs["scene-calibration"] = FileFingerprint(flags_.scene_calibration);
    }
    return JobHeader(nlohmann::ordered_json::parse(options_json_), names.size(),
                     {"problems", "csv", "json", "poses", "scene-calibration"}, inputs);
  }

  // Estimates the poses of these files until a signal; returns how many files are left.
  size_t Estimate(const std::vector<size_t>& places,
                  const std::function<void(size_t, EstimateRow)>& on_row) {
    if (flags_.scene_calibration.empty()) {
      UntilSignal(
          [this] { options_.scene_noise = LearnSceneNoise(files_, flags_, filter_, options_); });
    }
    const auto estimator = MakePoseEstimator(options_);
    std::atomic<size_t> left = places.size();
    Progress progress("problems", places.size(), flags_.run.Show());
    ParallelFor(places.size(), flags_.run.threads, [&](size_t i) {
      if (SignalGuard::stop()) return;
      const size_t place = places[i];
      on_row(place,
             raylift::Estimate(*estimator, options_.method, files_[place], filter_, flags_.repeat));
      --left;
      progress.Advance();
    });
    return left;
  }

  const EstimateFlags& flags_;
  const std::string& options_json_;
  EstimatorOptions options_;
  FilterOptions filter_;
  std::vector<ProblemFile> files_;
  std::vector<EstimateRow> rows_;
};

}  // namespace

Command AddEstimateCommand(CLI::App& program) {
  auto flags = std::make_shared<EstimateFlags>();
  CLI::App& command = AddCommand(
      program, "estimate", "Poses from pose problems (JSON files of matches); needs no geometry");
  const OptionGroup options(command);
  options.Add("problems", flags->problems, "Files, or folders of .json files").Required();
  const OptionGroup output(command, "Output");
  output.Add("--csv", flags->csv, "One row per problem");
  output.Add("--json", flags->json, "One object per problem");
  output.Add("--poses", flags->poses, "Pose file: name qw qx qy qz tx ty tz");
  output.Add("--out", flags->out,
             "Folder for estimates.csv, estimates.json, poses.txt and timing.jsonl, and\n"
             "for manifest.jsonl with what is done");
  options.Add("--scene-calibration", flags->scene_calibration,
              "What localize learned of the scene (its scene_calibration.json): how noisy\n"
              "matches are and, for --filter auto, its geometry. Without it, some 30 of the\n"
              "problems tell of the matches");
  options.Flag("--independent", flags->independent,
               "The problems are not of one scene: none tells of the noise of another's\n"
               "matches (where Adaptive estimates both kinds together)");
  const OptionGroup running(command, "Running");
  running.Add("--repeat", flags->repeat, "Estimate each problem N times; time_ms is the median");
  AddFilterOptions(command, flags->filter);
  AddEstimatorOptions(command, flags->estimator);
  AddJobOptions(command, flags->running,
                "With --out, go on where a run of the same options and problems was stopped\n"
                "or killed; it ends with the same bytes",
                "Begin anew in a folder where a former run was; else it is refused");
  AddRunOptions(command, flags->run);
  SetFooter(
      command,
      "With --out each problem that is done is kept; a signal finishes the problems in\n"
      "hand (exit code 4), and --shard, --resume, `raylift status` and `raylift merge` are as of\n"
      "localize.\n"
      "Examples:\n"
      "  raylift estimate problems --method select --alpha 0.9 --csv select.csv\n"
      "  raylift estimate problems --out adaptive --shard 1/4");
  return {&command,
          [flags, &command] { EstimateRun(*flags, EffectiveOptionsJson(command)).Run(); }};
}

}  // namespace raylift
