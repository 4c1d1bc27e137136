#include "jobs/job_status.h"

#include <map>
#include <set>

#include "jobs/manifest_file.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;
using std::filesystem::path;
using State = ShardStatus::State;

struct Header {
  std::string command;
  size_t tasks = 0;
};

Header ParseHeader(const path& file, const std::string& text) {
  try {
    const Json header = Json::parse(text);
    const Json& tasks = header.at("tasks");
    // One that is no whole number would be made one, whether or not it fits.
    if (tasks.is_number_unsigned()) {
      return {header.at("command").get<std::string>(), tasks.get<size_t>()};
    }
  } catch (const Json::exception&) {  // said below
  }
  throw InputError(file, "line 1", "is no header of a job");
}

std::set<std::string> NamesOfTasks(const ManifestText& manifest) {
  std::set<std::string> names;
  for (const std::string& line : manifest.lines) {
    const Json task = Json::parse(line, nullptr, /*allow_exceptions=*/false);
    if (task.is_object() && task.contains("name")) names.insert(task["name"].dump());
  }
  return names;
}

// Returns how many tasks are dealt to one of `count`.
size_t NumTasks(size_t tasks, const Shard& shard) {
  const auto count = static_cast<size_t>(shard.count);
  return (tasks + count - 1 - static_cast<size_t>(shard.index)) / count;
}

State StateOf(const ShardStatus& status, const path& file) {
  if (status.done >= status.tasks) return State::kDone;
  if (IsBeingAppended(file)) return State::kRunning;
  return Exists(file) ? State::kStopped : State::kNotBegun;
}

}  // namespace

JobStatus ReadJobStatus(const path& out) {
  const std::vector<path> files = ListManifests(out);
  if (files.empty()) throw InputError(out, "holds no manifest of a job");
  std::string header;
  std::set<std::string> all;
  std::map<int, size_t> done_of_shard;
  int count = 1;
  for (const path& file : files) {
    const ManifestText manifest = ReadManifestText(file);
    if (header.empty()) header = manifest.header;
    const Shard shard = *ShardOfManifest(file);
    const bool divided_otherwise = count > 1 && !shard.IsAll() && shard.count != count;
    if (manifest.header != header || divided_otherwise) {
      throw InputError(file,
                       fmt::format("is a part of another job than {}", files.front().string()));
    }
    if (!shard.IsAll()) count = shard.count;
    std::set<std::string> names = NamesOfTasks(manifest);
    if (!shard.IsAll()) done_of_shard[shard.index] = names.size();
    all.merge(names);
  }
  const Header parsed = ParseHeader(files.front(), header);
  JobStatus status{parsed.command, parsed.tasks, all.size(), {}};
  for (int i = 0; i < count; ++i) {
    ShardStatus& shard = status.shards.emplace_back();
    shard.shard = {i, count};
    shard.tasks = NumTasks(status.tasks, shard.shard);
    shard.done = count == 1 ? status.done : done_of_shard[i];
    shard.state = StateOf(shard, ManifestPath(out, shard.shard));
  }
  return status;
}

std::string ShardsToSubmit(const JobStatus& status) {
  std::string text;
  const auto is_left = [&status](size_t i) {
    return i < status.shards.size() && status.shards[i].state != State::kDone &&
           status.shards[i].state != State::kRunning;
  };
  for (size_t i = 0; i < status.shards.size(); ++i) {
    if (!is_left(i)) continue;
    const size_t first = i;
    while (is_left(i + 1)) ++i;
    if (!text.empty()) text += ',';
    text += first == i ? std::to_string(i) : fmt::format("{}-{}", first, i);
  }
  return text;
}

}  // namespace raylift
