// The manifest (manifest_file.h) of a run whose results follow from it alone: a header, a line of
// what all tasks have in common where there is such a thing (the facts), and a line for each task
// that is done: {"name": ..., "place": ..., "key": ..., ...}.

#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>

namespace raylift {

struct TaskRecord {
  size_t place = 0;  // in the list of all tasks
  std::string line;
};

struct TaskManifest {
  std::string header;  // empty: there is no manifest
  std::optional<std::string> facts;
  std::map<std::string, TaskRecord> records;  // by key
};

// Whether a line of facts or of a task can be read by who has written it.
using IsReadable = std::function<bool(const std::string& line)>;

// Lines that make no sense, or are not readable, count as not there.
TaskManifest ReadTaskManifest(const std::filesystem::path& file, const IsReadable& is_readable);
// Takes the records, the facts and the header of a part of the same run.
void AddPart(TaskManifest part, TaskManifest& all);
// Of `files`, which must all be of one run. InputError naming the file that is of another one.
TaskManifest ReadTaskManifests(std::span<const std::filesystem::path> files,
                               const IsReadable& is_readable);

// With the tasks in the order of the list.
void WriteTaskManifest(const std::filesystem::path& file, const TaskManifest& manifest);
// To `out`, whose manifests of shards are no longer needed.
void WriteWholeManifest(const std::filesystem::path& out, const TaskManifest& manifest);

// Where two headers, JSON both, first differ: "options/seed: 0 there, 1 here".
std::string HeaderDifference(const std::string& there, const std::string& here);

}  // namespace raylift
