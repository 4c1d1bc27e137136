// The file in which a job keeps what is done: a line of JSON on the job (the header), then a line
// for each task, added the moment it is complete, so that a killed run can go on where it was.
// Shards have files of their own, until all of them are complete.

#pragma once

#include <filesystem>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/jobs/shard.h"

namespace raylift {

// manifest.jsonl, or manifest.I-of-N.jsonl of a shard.
std::filesystem::path ManifestPath(const std::filesystem::path& out, const Shard& shard);
// What a file of that name is of; none where it has another name.
std::optional<Shard> ShardOfManifest(const std::filesystem::path& manifest);
// Of the whole job and of any shard, sorted.
std::vector<std::filesystem::path> ListManifests(const std::filesystem::path& out);
// Of another part of the same division of the job.
bool IsManifestOfOtherShard(const std::filesystem::path& manifest, const Shard& shard);

struct ManifestText {
  std::string header;
  std::vector<std::string> lines;

  // Of the lines, those of tasks: they begin with the task's name, {"name":...
  size_t CountTasks() const;
};

// A last line without its end, which a crash has cut off, counts as not there; so does a missing
// file.
ManifestText ReadManifestText(const std::filesystem::path& manifest);

// The whole file at once. OutputError naming it where it cannot be written.
void WriteManifestText(const std::filesystem::path& manifest, const std::string& header,
                       std::span<const std::string> lines);

// Whether a ManifestAppender of any process has the file open, as far as the file system has locks.
bool IsBeingAppended(const std::filesystem::path& manifest);
// InputError where one has: to be asked before a manifest is written anew.
void RefuseIfAppended(const std::filesystem::path& manifest);

// Adds lines to a manifest that is there. Thread safe.
class ManifestAppender {
 public:
  // OutputError where it cannot be opened, InputError where another one has it open.
  explicit ManifestAppender(std::filesystem::path manifest);
  ~ManifestAppender();
  ManifestAppender(const ManifestAppender&) = delete;
  ManifestAppender& operator=(const ManifestAppender&) = delete;

  // `line` is without its end. It is with the operating system when the call returns.
  void Append(std::string line);

 private:
  std::filesystem::path path_;
  std::mutex mutex_;
  int descriptor_;
};

}  // namespace raylift
