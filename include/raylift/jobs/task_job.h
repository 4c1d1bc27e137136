// A run of many tasks that keeps their results as they come: in a folder, by itself or side by side
// with the other shards of the run, and so that a killed run goes on where it was. Whatever happens
// in between, the results are those of one run that was left alone.

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
// results. Whoever goes on with the job or ends it looks whether they are there.

struct PromisedFile {
  std::string path;  // relative to the job's folder
  size_t bytes = 0;
  // As `xxhsum -H3` writes it. Empty: the contents are of one run alone.
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
  // Begin anew where there was a former run. With neither of the two its folder is refused.
  bool overwrite = false;
  bool wait = false;  // until another run that writes to the folder has ended; else it is an error
};

// A task that is done: its line in the manifest is {"name": ..., "place": ..., "key": ..., ...,
// "files": [...]}, the last of these where it has files of its own (PromisedFile). A task whose
// files are not there is not done.
struct TaskRecord {
  size_t place = 0;  // in the list of all tasks
  std::string line;
};

// A job's manifest: a header of all that the results depend on, a line of what all tasks have in
// common where there is such a thing (the facts), a line for each task that is done, and a last one
// of the results.
struct TaskManifest {
  std::string header;  // empty: there is no manifest
  std::optional<std::string> facts;
  std::map<std::string, TaskRecord> records;  // by key
  std::vector<PromisedFile> results = {};     // of a job that is complete
  // The vector instructions ("avx2") of the machines that shards ran on, whose last digits differ.
  std::set<std::string> instructions = {};
};

// Says so where the machines of a job's shards differ; empty where they do not.
std::vector<std::string> MachineWarnings(const TaskManifest& manifest);

// Returns whether a line of facts or of a task can be read by the command that has written it.
using IsReadable = std::function<bool(const std::string& line)>;

// The properties that tell one command's jobs from another's.
struct JobForm {
  // The files that a complete run leaves in its folder; where the first is, there was one.
  std::vector<std::string> results;
  IsReadable is_readable;

  // For jobs of which nothing but the tasks' files counts: for each task the hash of all that its
  // files depend on. A run that goes on keeps the tasks whose keys are the same, whatever else has
  // changed; without, it must have had the same header.
  std::vector<std::string> keys = {};
  int threads = 0;
};

// Throws OptionError where the folder holds a former run, as far as can be told without its header
// (shards work side by side), and the options do not say what is to become of it.
void RefuseFormerRun(const JobFolder& folder, const JobForm& form);

// Removes a former run's manifests and results; while there are manifests with the header `kept`,
// which is no run's where it is empty, neither these nor the results.
void RemoveFormerRun(const std::filesystem::path& out, const JobForm& form,
                     const std::string& kept = {});

class TaskJob {
 public:
  // `names` are distinct; `header` is JSON of all that the results depend on. OptionError as above;
  // Throws InputError where a run that is to go on had another header, naming what differs, or
  // another run is at work.
  TaskJob(const std::vector<std::string>& names, const std::string& header, JobFolder folder,
          JobForm form);
  ~TaskJob();

  // Returns what is done of this shard, and the facts as this or another run of the same header
  // found them.
  const TaskManifest& manifest() const { return manifest_; }
  // Returns the key of a task, which is given by its place in the list.
  const std::string& key(size_t task) const { return keys_[task]; }

  // Before the first Add(): from now on there is a manifest. What was there before stays until
  // then. Throws OutputError where it cannot be written, InputError where another run is at work.
  void Begin(const std::optional<std::string>& facts);

  // Returns the tasks of this shard that are not done, once the others would survive a loss of
  // power; throws what one of these could not be kept for.
  std::vector<size_t> Missing() const;

  // A task is done; `line` is {"name": ..., "place": `task`, "key": key(task), ...}. Thread safe.
  void Add(size_t task, const std::string& line);

  // Returns what is done of all shards, once all are; nullopt before. Throws OutputError where what
  // this run has written or kept is no longer there.
  std::optional<TaskManifest> Whole() const;
  // With Whole(), perhaps in a form that does not show who has done what, and the files of the
  // results, which are written. The job is complete. Throws OutputError where one is gone.
  void Finish(TaskManifest whole, std::span<const std::filesystem::path> results);

 private:
  void TakeFormerRuns(const std::string& header);
  bool TakeRecord(size_t task, const TaskManifest& from, TaskManifest& to) const;
  bool GoesOnAnyway() const { return !form_.keys.empty(); }
  // Returns the tasks whose files are not there.
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
