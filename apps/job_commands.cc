// raylift status, merge and verify: print how far the jobs of a folder are, merge the results of
// shards, and check that the files of a run are still as they were written.

#include <algorithm>
#include <memory>
#include <vector>

#include "apps/commands.h"
#include "apps/estimate_results.h"
#include "apps/interrupt.h"
#include "apps/options.h"
#include "jobs/file_promises.h"
#include "jobs/job_status.h"
#include "jobs/manifest_file.h"
#include "localization/results/query_job.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/jobs/task_job.h"
#include "raylift/sequences/smooth_queries.h"

namespace raylift {
namespace {

using std::filesystem::path;

std::string_view StateName(ShardStatus::State state) {
  switch (state) {
    case ShardStatus::State::kDone:
      return "done";
    case ShardStatus::State::kRunning:
      return "running";
    case ShardStatus::State::kStopped:
      return "stopped or failed";
    case ShardStatus::State::kNotBegun:
      return "nothing done yet";
  }
  return {};
}

void PrintStatus(const JobStatus& status) {
  for (const ShardStatus& shard : status.shards) {
    if (status.shards.size() == 1) {
      fmt::print("{}: {}\n", status.command, StateName(shard.state));
    } else {
      fmt::print("shard {}/{}: {} of {}, {}\n", shard.shard.index, shard.shard.count, shard.done,
                 shard.tasks, StateName(shard.state));
    }
  }
  fmt::print("done: {} of {}\n", status.done, status.tasks);
  const std::string left = ShardsToSubmit(status);
  if (!left.empty() && status.shards.size() > 1) {
    fmt::print("to submit again: --array={} with --shard auto/{} --resume\n", left,
               status.shards.size());
  }
}

struct MergeFlags {
  path out;
  std::vector<path> parts;
};

// Returns the manifests of OUT and of all parts, which are folders or manifests.
std::vector<path> FilesOf(const MergeFlags& flags) {
  std::vector<path> files = ListManifests(flags.out);
  for (const path& part : flags.parts) {
    const std::vector<path> found =
        std::filesystem::is_directory(part) ? ListManifests(part) : std::vector<path>{part};
    if (found.empty()) throw InputError(part, "holds no manifest of a run");
    files.insert(files.end(), found.begin(), found.end());
  }
  if (files.empty()) throw InputError(flags.out, "holds no manifest of a run");
  return files;
}

struct Header {
  std::string command;
  size_t tasks = 0;
};

Header ReadHeader(const path& file) {
  const auto json =
      nlohmann::json::parse(ReadManifestText(file).header, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || !json.contains("command") || !json.contains("tasks")) {
    throw InputError(file, "line 1", "is no header of a job");
  }
  return {json.at("command").get<std::string>(), json.at("tasks").get<size_t>()};
}

// Throws InputError for a name that is not UTF-8, which JSON needs and a list of queries does not.
void RequireNames(std::span<const QueryRecord> records) {
  constexpr std::string_view kReplacement = "\xEF\xBF\xBD";
  for (const QueryRecord& record : records) {
    if (record.localized.name.find(kReplacement) == std::string::npos) continue;
    throw InputError(
        fmt::format("the query \"{}\" has a name that is not UTF-8: let the shards "
                    "write to one folder, which needs no merging",
                    record.localized.name));
  }
}

// Copies a file that each shard has in its folder, the same for all.
void TakeFile(const std::string& name, const path& out, std::span<const path> files) {
  for (const path& file : files) {
    const path part = file.parent_path() / name;
    if (!Exists(part)) continue;
    WriteFile(out / name, ReadFile(part));
    return;
  }
}

// Returns whether a run of localize with these options had a walk.
bool HasOdometry(const path& options) {
  if (!Exists(options)) return false;
  const auto json = nlohmann::json::parse(ReadFile(options), nullptr, /*allow_exceptions=*/false);
  const auto odometry = json.is_object() ? json.find("odometry") : json.end();
  return odometry != json.end() && odometry->is_string() && *odometry != "";
}

// Merges the parts of one run that is complete.
class Merger {
 public:
  explicit Merger(const MergeFlags& flags)
      : out_(flags.out), files_(FilesOf(flags)), header_(ReadHeader(files_.front())) {}

  void Merge() const {
    if (header_.command == "localize") {
      MergeLocalize();
    } else if (header_.command == "estimate") {
      MergeEstimate();
    } else if (header_.command == "experiment") {
      MergeExperiment(out_, files_);
    } else {
      throw InputError(
          files_.front(), "line 1",
          fmt::format("expected a manifest of localize, estimate or experiment, found one of {}",
                      header_.command));
    }
  }

 private:
  // Returns the manifests of all parts as one; `tasks` is the name of tasks in the message. Throws
  // Interrupted where some are not done.
  TaskManifest ReadAll(const JobForm& form, std::string_view tasks) const {
    TaskManifest all = ReadTaskManifests(files_, form.is_readable, out_);
    if (all.records.size() >= header_.tasks) {
      PrintWarnings(MachineWarnings(all));
      return all;
    }
    throw Interrupted(fmt::format("{} of {} {} are not done in {}: nothing is merged",
                                  header_.tasks - all.records.size(), header_.tasks, tasks,
                                  files_.size() == 1 ? files_.front().string() : "these parts"));
  }

  void MergeLocalize() const {
    RequireWritable(out_ / "poses.txt");
    const FolderLock lock(out_, FolderLock::Mode::kExclusive);
    const TaskManifest all = ReadAll(QueryJobForm(out_), "queries");
    const std::optional<RunFacts> facts = FactsOf(all);
    if (!facts) throw InputError(files_.front(), "holds no line of the scene");
    const std::vector<QueryRecord> records = RecordsOf(all);
    RequireNames(records);
    TakeFile("depth_alignment.jsonl", out_, files_);
    const CommittedFiles results;
    WriteResults(out_, *facts, records, std::nullopt);
    TakeFile("options.json", out_, files_);
    RemoveWalk(out_);
    TaskManifest whole = WithRecords(all, records);
    whole.results = PromiseFiles(out_, results.paths());
    WriteWholeManifest(out_, whole);
    PrintWarnings(AllWarnings(*facts, records));
    if (HasOdometry(out_ / "options.json")) {
      PrintWarnings(
          {"the walk is not smoothed by merge: localize with the same --out, --odometry "
           "and --resume does so"});
    }
    const auto localized =
        std::count_if(records.begin(), records.end(),
                      [](const QueryRecord& record) { return record.localized.localized(); });
    fmt::print("merged {} parts: localized {} of {} queries: {}\n", files_.size(), localized,
               header_.tasks, (out_ / "poses.txt").string());
  }

  void MergeEstimate() const {
    RequireWritable(out_ / "poses.txt");
    const FolderLock lock(out_, FolderLock::Mode::kExclusive);
    const TaskManifest all = ReadAll(EstimateJobForm(), "problems");
    TakeFile("options.json", out_, files_);
    const std::vector<EstimateRow> rows = EstimateRowsOf(all);
    const CommittedFiles results;
    WriteEstimates(out_, rows);
    TaskManifest whole = WithoutTimes(all);
    whole.results = PromiseFiles(out_, results.paths());
    WriteWholeManifest(out_, whole);
    fmt::print("merged {} parts: {} of {} problems have a pose: {}\n", files_.size(),
               PosesOf(rows).size(), rows.size(), (out_ / "poses.txt").string());
  }

  const path& out_;
  std::vector<path> files_;
  Header header_;
};

void Verify(const std::filesystem::path& out, const RunFlags& run) {
  const JobStatus status = ReadJobStatus(out);
  const Verification found = VerifyFiles(out, run.threads);
  for (const FileFault& fault : found.faults) fmt::print("{} {}\n", fault.file, fault.what);
  if (!found.faults.empty()) {
    throw InputError(out, fmt::format("{} of {} files are not as they were written; {} --resume "
                                      "makes them anew",
                                      found.faults.size(), found.files, status.command));
  }
  if (run.quiet) return;
  fmt::print("{} tasks of {}, {} files, {:.1f} MB: all are as they were written\n", found.tasks,
             status.command, found.files, 1e-6 * static_cast<double>(found.bytes));
}

}  // namespace

Command AddStatusCommand(CLI::App& program) {
  auto out = std::make_shared<std::filesystem::path>();
  CLI::App& command =
      AddCommand(program, "status", "How far a run with --shard and --resume is, and its shards");
  const OptionGroup options(command);
  options.Add("OUT", *out, "The folder of --out").Required();
  AddConfigOption(command);
  SetFooter(command,
            "The exit code is 0 where all is done, 4 where work is left.\n"
            "Example:\n"
            "  raylift status result || sbatch --array=... job.sh");
  return {&command, [out] {
            const JobStatus status = ReadJobStatus(*out);
            PrintStatus(status);
            if (!status.IsComplete()) {
              throw Interrupted(fmt::format("{}: {} of {} are not done", out->string(),
                                            status.tasks - status.done, status.tasks));
            }
          }};
}

Command AddMergeCommand(CLI::App& program) {
  auto flags = std::make_shared<MergeFlags>();
  CLI::App& command =
      AddCommand(program, "merge", "The results of a run from shards in other folders");
  const OptionGroup options(command);
  options.Add("OUT", flags->out, "Folder for the results; its own parts count, too").Required();
  options.Add("PART", flags->parts, "Folders of shards, or their manifests");
  AddConfigOption(command);
  SetFooter(
      command,
      R"(The results of localize and estimate, and the manifest, are those of a run that was not
shared, but for its times. What each query has written by itself (--write-problems,
--pictures) stays where it is, and --write-model is for shards of one folder. The exit code
is 4 where queries are not done. Shards of render that write to one folder need no merging.
Example:
  raylift merge result shard_0 shard_1 shard_2)");
  return {&command, [flags] { UntilSignal([&] { Merger(*flags).Merge(); }, &BeginsAnew); }};
}

Command AddVerifyCommand(CLI::App& program) {
  struct Flags {
    std::filesystem::path out;
    RunFlags run;
  };
  auto flags = std::make_shared<Flags>();
  CLI::App& command = AddCommand(
      program, "verify", "Whether the files of a run are still as they were written (checksums)");
  const OptionGroup options(command);
  options.Add("OUT", flags->out, "The folder of --out").Required();
  AddRunOptions(command, flags->run);
  SetFooter(command,
            "Prints the files that are missing or have other contents; the exit code then is 3.\n"
            "The manifest's checksums are those of `xxhsum -H3`.\n"
            "Example:\n"
            "  raylift verify rendered");
  return {&command, [flags] {
            flags->run.Check();
            UntilSignal([&] { Verify(flags->out, flags->run); }, &BeginsAnew);
          }};
}

}  // namespace raylift
