// The manifest, in which a job records the tasks that are done: a line of JSON on the job (the
// header), then a line for each task, added once its files are synced, so that a killed run can go
// on where it was (and may do the last ones again). Shards have files of their own, until all of
// them are complete.

#pragma once

#include <condition_variable>
#include <cstddef>
#include <exception>
#include <filesystem>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "raylift/jobs/shard.h"
#include "raylift/jobs/task_job.h"

namespace raylift {

// Returns manifest.jsonl, or manifest.I-of-N.jsonl of a shard.
std::filesystem::path ManifestPath(const std::filesystem::path& out, const Shard& shard);
// Returns the shard that a file of that name is of; nullopt if it has another name.
std::optional<Shard> ShardOfManifest(const std::filesystem::path& manifest);
// Returns the manifests of the whole job and of any shard, sorted.
std::vector<std::filesystem::path> ListManifests(const std::filesystem::path& out);
// Returns whether it is of another part of the same division of the job.
bool IsManifestOfOtherShard(const std::filesystem::path& manifest, const Shard& shard);

struct ManifestText {
  std::string header;
  std::vector<std::string> lines;

  // Returns how many lines are of tasks: these begin with the task's name, {"name":...
  size_t CountTasks() const;
};

// Reads a manifest. A last line without its end, which a crash has cut off, counts as absent; so
// does a missing file.
ManifestText ReadManifestText(const std::filesystem::path& manifest);

// Writes the whole file at once. Throws OutputError naming it where it cannot be written.
void WriteManifestText(const std::filesystem::path& manifest, const std::string& header,
                       std::span<const std::string> lines);

// Returns whether a ManifestAppender of any process has the file open, as far as there are locks.
bool IsBeingAppended(const std::filesystem::path& manifest);
// Throws InputError where one has: to be called before a manifest is written anew.
void RefuseIfAppended(const std::filesystem::path& manifest);

// Adds lines to a manifest that is there, on a thread of its own: the files that lines promise are
// synced before the lines are written, and these then, as many together as have come meanwhile.
// Thread safe.
class ManifestAppender {
 public:
  // Throws OutputError where it cannot be opened, InputError where another one has it open.
  explicit ManifestAppender(std::filesystem::path manifest);
  ~ManifestAppender();
  ManifestAppender(const ManifestAppender&) = delete;
  ManifestAppender& operator=(const ManifestAppender&) = delete;

  // Appends `line`, given without its end. Rethrows the error of a line that could not be written
  // before.
  void Append(std::string line);
  // Returns when all lines would survive a loss of power; throws as Append().
  void Flush();

  // Throws OutputError where the file has been removed or replaced.
  void RequireInPlace() const;

 private:
  void WriteLines();
  void Write(std::span<const std::string> lines) const;

  std::filesystem::path path_;
  int descriptor_;
  std::mutex mutex_;  // guards what follows, but for the thread
  std::condition_variable changed_;
  std::vector<std::string> waiting_;
  bool writing_ = false;
  bool ends_ = false;
  std::exception_ptr failure_;
  std::thread writer_;
};

// Keeps two runs from writing to the same folder at the same time.
class FolderLock {
 public:
  // kShared: shards of one job write side by side.
  enum class Mode { kExclusive, kShared };
  // kWait: a watch of the call (base/call_watch.h) can end the waiting.
  enum class IfHeld { kFail, kWait };

  // Throws InputError where another run holds the folder; file systems without locks have none.
  FolderLock(const std::filesystem::path& folder, Mode mode, IfHeld if_held = IfHeld::kFail);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int descriptor_;
};

// Reads a manifest. Lines that cannot be parsed, or are not readable, count as absent. So do the
// results: they are written anew.
TaskManifest ReadTaskManifest(const std::filesystem::path& file, const IsReadable& is_readable);
// Takes the records, the facts and the header of a part of the same run.
void AddPart(TaskManifest part, TaskManifest& all);
// Reads `files`, which must all be of one run, as parts of a manifest in the folder `out`. Throws
// InputError naming the file of another one.
TaskManifest ReadTaskManifests(std::span<const std::filesystem::path> files,
                               const IsReadable& is_readable, const std::filesystem::path& out);

// Writes a manifest with the tasks in the order of the list.
void WriteTaskManifest(const std::filesystem::path& file, const TaskManifest& manifest);
// Writes the manifest of the whole job to `out`, whose manifests of shards are no longer needed.
void WriteWholeManifest(const std::filesystem::path& out, const TaskManifest& manifest);

// Returns where two headers, JSON both, first differ: "options/seed: 0 there, 1 here".
std::string HeaderDifference(const std::string& there, const std::string& here);

}  // namespace raylift
