// raylift merge: the results of a whole run from its parts.

#include <algorithm>
#include <memory>
#include <vector>

#include "commands.h"
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

// How many queries the run has.
size_t NumQueries(const path& file, const std::string& header) {
  const auto json = nlohmann::json::parse(header, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || json.value("command", "") != "localize") {
    throw InputError(file, "line 1", "expected a manifest of `raylift localize`");
  }
  return json.at("tasks").get<size_t>();
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

void Merge(const MergeFlags& flags) {
  const std::vector<path> files = FilesOf(flags);
  RequireWritable(flags.out / "poses.txt");
  const FolderLock lock(flags.out, FolderLock::Mode::kExclusive);
  const QueryManifest all = ReadQueryManifests(files);
  const size_t count = NumQueries(files.front(), all.header);
  if (!all.facts || all.records.size() < count) {
    throw Interrupted(fmt::format("{} of {} queries are not done in {}: nothing is merged",
                                  count - all.records.size(), count,
                                  files.size() == 1 ? files.front().string() : "these parts"));
  }
  const std::vector<QueryRecord> records = InOrder(all.records);
  RequireNames(records);
  WriteResults(flags.out, *all.facts, records, std::nullopt);
  for (const char* name : {"options.json", "depth_alignment.jsonl"}) {
    TakeFile(name, flags.out, files);
  }
  WriteWholeManifest(flags.out, all);
  PrintWarnings(AllWarnings(*all.facts, records));
  const auto localized =
      std::count_if(records.begin(), records.end(),
                    [](const QueryRecord& record) { return record.localized.localized(); });
  fmt::print("merged {} parts: localized {} of {} queries: {}\n", files.size(), localized, count,
             (flags.out / "poses.txt").string());
}

}  // namespace

Command AddMergeCommand(CLI::App& program) {
  auto flags = std::make_shared<MergeFlags>();
  CLI::App* command =
      program.add_subcommand("merge", "The results of localize from shards in other folders");
  command->add_option("OUT", flags->out, "Folder for the results; its own parts count, too")
      ->required();
  command->add_option("PART", flags->parts, "Folders of shards, or their manifests");
  AddConfigOption(*command);
  command->footer(
      "poses.txt, queries.jsonl, summary.json and the manifest are those of a run that was not\n"
      "shared, but for its times. What each query has written by itself (--write-problems,\n"
      "--pictures) stays where it is, and --write-model is for shards of one folder. The exit "
      "code\n"
      "is 4 where queries are not done. Shards of render that write to one folder need no "
      "merging.\n"
      "Example:\n"
      "  raylift merge result shard_0 shard_1 shard_2");
  return {command, [flags] { Merge(*flags); }};
}

}  // namespace raylift
