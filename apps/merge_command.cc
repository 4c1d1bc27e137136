// raylift merge: the results of a whole run from its parts.

#include <algorithm>
#include <memory>
#include <vector>

#include "commands.h"
#include "estimate_results.h"
#include "experiment_run.h"
#include "interrupt.h"
#include "options.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/jobs/folder_lock.h"
#include "raylift/localization/query_job.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct MergeFlags {
  path out;
  std::vector<path> parts;
};

// The manifests of OUT and of all parts, which are folders or manifests.
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

// JSON holds names as UTF-8, the list of queries need not.
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

// What each shard has in its folder, the same for all.
void TakeFile(const std::string& name, const path& out, std::span<const path> files) {
  std::error_code ignored;
  for (const path& file : files) {
    const path part = file.parent_path() / name;
    if (std::filesystem::exists(out / name, ignored)) return;
    if (std::filesystem::exists(part, ignored)) WriteFile(out / name, ReadFile(part));
  }
}

// The parts of one run that is complete.
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
  // `tasks` names them. Throws Interrupted where some are not done.
  TaskManifest ReadAll(const JobForm& form, std::string_view tasks) const {
    TaskManifest all = ReadTaskManifests(files_, form.is_readable);
    if (all.records.size() >= header_.tasks) return all;
    throw Interrupted(fmt::format("{} of {} {} are not done in {}: nothing is merged",
                                  header_.tasks - all.records.size(), header_.tasks, tasks,
                                  files_.size() == 1 ? files_.front().string() : "these parts"));
  }

  void MergeLocalize() const {
    RequireWritable(out_ / "poses.txt");
    const FolderLock lock(out_, FolderLock::Mode::kExclusive);
    const TaskManifest all = ReadAll(QueryJobForm(), "queries");
    const std::optional<RunFacts> facts = FactsOf(all);
    if (!facts) throw InputError(files_.front(), "holds no line of the scene");
    const std::vector<QueryRecord> records = RecordsOf(all);
    RequireNames(records);
    WriteResults(out_, *facts, records, std::nullopt);
    for (const char* name : {"options.json", "depth_alignment.jsonl"}) {
      TakeFile(name, out_, files_);
    }
    WriteWholeManifest(out_, WithRecords(all, records));
    PrintWarnings(AllWarnings(*facts, records));
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
    WriteEstimates(out_, rows);
    WriteWholeManifest(out_, all);
    fmt::print("merged {} parts: {} of {} problems have a pose: {}\n", files_.size(),
               PosesOf(rows).size(), rows.size(), (out_ / "poses.txt").string());
  }

  const path& out_;
  std::vector<path> files_;
  Header header_;
};

}  // namespace

Command AddMergeCommand(CLI::App& program) {
  auto flags = std::make_shared<MergeFlags>();
  CLI::App* command =
      program.add_subcommand("merge", "The results of a run from shards in other folders");
  command->add_option("OUT", flags->out, "Folder for the results; its own parts count, too")
      ->required();
  command->add_option("PART", flags->parts, "Folders of shards, or their manifests");
  AddConfigOption(*command);
  command->footer(
      "The results of localize and estimate, and the manifest, are those of a run that was not\n"
      "shared, but for its times. What each query has written by itself (--write-problems,\n"
      "--pictures) stays where it is, and --write-model is for shards of one folder. The exit "
      "code\n"
      "is 4 where queries are not done. Shards of render that write to one folder need no "
      "merging.\n"
      "Example:\n"
      "  raylift merge result shard_0 shard_1 shard_2");
  return {command, [flags] { Merger(*flags).Merge(); }};
}

}  // namespace raylift
