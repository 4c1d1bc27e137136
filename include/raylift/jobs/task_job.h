// Runs many tasks and keeps their results as they come, in a folder: by one process or by several
// shards side by side, and so that a killed run can be resumed. Whatever happens in between, the
// results are those of one uninterrupted run.

#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "raylift/jobs/shard.h"

namespace raylift {

// The files that a job's manifest promises: those that a task has written, and in the end the
// results. A run that resumes or completes the job checks that they are there.

struct PromisedFile {
  std::string path;  // relative to the job's folder
  size_t bytes = 0;
  // It is as `xxhsum -H3` writes it, and empty where the contents are of one run alone.
  std::string xxh3 = {};
};

struct FileFault {
  std::string file;  // relative to the folder
  std::string what;
};

struct Verification {
  size_t tasks = 0;
  size_t files = 0;
  size_t bytes = 0;
  std::vector<FileFault> faults = {};  // in the order of the manifests
};

// Reads all files that the folder's manifests promise and compares sizes and checksums.
Verification VerifyFiles(const std::filesystem::path& out, int threads);

class FolderLock;
class ManifestAppender;
enum class FileCheck;

struct JobFolder {
  std::filesystem::path out;
  Shard shard = {};
  bool resume = false;  // keep what former runs have left
  // Starts anew where there was a former run. With neither of the two a folder with a former run is
  // refused.
  bool overwrite = false;
  bool wait = false;  // until another run that writes to the folder has ended; else it is an error
};

// A task that is done. Its line in the manifest is {"name": ..., "place": ..., "key": ..., ...,
// "files": [...]}, where "files" stands if the task has files of its own (PromisedFile). A task
// whose files are missing counts as not done.
struct TaskRecord {
  size_t place = 0;  // in the list of all tasks
  std::string line;
};

// A job's manifest: a header of all that the results depend on, a line of what all tasks have in
// common if there is any (the facts), a line for each task that is done, and at last one of the
// results.
struct TaskManifest {
  std::string header;  // empty: there is no manifest
  std::optional<std::string> facts;
  std::map<std::string, TaskRecord> records;  // by key
  std::vector<PromisedFile> results = {};     // of a job that is complete
  // The vector instructions ("avx2") of the machines that shards ran on, whose last digits differ.
  std::set<std::string> instructions = {};
};

// Returns warnings where the machines of a job's shards differ.
std::vector<std::string> MachineWarnings(const TaskManifest& manifest);

// Returns whether a line of facts or of a task can be read by the command that has written it.
using IsReadable = std::function<bool(const std::string& line)>;

// The properties that tell one command's jobs from another's.
struct JobForm {
  // The files that a complete run leaves in its folder; the first tells that there was such a run.
  std::vector<std::string> results;
  IsReadable is_readable;

  // For jobs of which only the tasks' files count: for each task the hash of all that its files
  // depend on. A resumed run keeps the tasks of equal keys, whatever else has changed; without keys
  // the former run must have had the same header.
  std::vector<std::string> keys = {};
  int threads = 0;
};

// Throws OptionError where the folder holds a former run, as far as that can be told without its
// header (shards work side by side), and the options do not say to resume or to overwrite it.
void RefuseFormerRun(const JobFolder& folder, const JobForm& form);

// Removes a former run's manifests and results. While there are manifests with the header `kept`
// (empty for none), these and the results stay.
void RemoveFormerRun(const std::filesystem::path& out, const JobForm& form,
                     const std::string& kept = {});

class TaskJob {
 public:
  // Takes distinct `names` and a `header`, JSON of all that the results depend on. Throws
  // OptionError as above, InputError where a run to be resumed had another header, naming what
  // differs, or another run is at work.
  TaskJob(const std::vector<std::string>& names, const std::string& header, JobFolder folder,
          JobForm form);
  ~TaskJob();

  // Returns the tasks of this shard that are done, and the facts as this or another run of the same
  // header found them.
  const TaskManifest& manifest() const { return manifest_; }
  // Returns the key of the task at a place of the list.
  const std::string& key(size_t task) const { return keys_[task]; }

  // Starts the manifest; to be called before the first Add(). What was there before stays until
  // then. Throws OutputError where it cannot be written, InputError where another run is at work.
  void Begin(const std::optional<std::string>& facts);

  // Returns the tasks of this shard that are not done, after syncing the files of the others to
  // disk; throws where one cannot be synced.
  std::vector<size_t> Missing() const;

  // Records that a task is done; `line` is {"name": ..., "place": `task`, "key": key(task), ...}.
  // Thread safe.
  void Add(size_t task, const std::string& line);

  // Returns the tasks of all shards, once all are done; nullopt before. Throws OutputError where a
  // file that this run has written or kept is no longer there.
  std::optional<TaskManifest> Whole() const;
  // Completes the job with Whole()'s manifest, perhaps in a form that does not show which process
  // has done what, and the files of the results, which are written by now. Throws OutputError where
  // one is missing.
  void Finish(TaskManifest whole, std::span<const std::filesystem::path> results);

 private:
  void TakeFormerRuns(const std::string& header);
  bool TakeRecord(size_t task, const TaskManifest& from, TaskManifest& to) const;
  bool GoesOnAnyway() const { return !form_.keys.empty(); }
  // Returns the tasks whose files are missing.
  std::vector<size_t> WithoutFiles(const TaskManifest& manifest, FileCheck check) const;
  void RequireFiles() const;
  std::optional<TaskManifest> WholeOfShards() const;
  TaskManifest ReadAll(const std::string& header) const;

  JobFolder folder_;
  JobForm form_;
  std::vector<std::string> keys_;
  std::filesystem::path file_;  // the manifest
  std::unique_ptr<FolderLock> lock_;
  TaskManifest manifest_;     // of this shard
  mutable std::mutex mutex_;  // guards the manifest's records
  std::unique_ptr<ManifestAppender> appender_;
};

}  // namespace raylift
