#include "raylift/jobs/task_job.h"

#include <utility>

#include "base/hash.h"
#include "jobs/manifest_file.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using std::filesystem::path;

[[noreturn]] void FailByFormerRun(const path& file) {
  throw OptionError(
      "overwrite", "false",
      fmt::format("{} is of a former run; resume = true keeps what is done", file.string()));
}

}  // namespace

void RefuseFormerRun(const JobFolder& folder, const JobForm& form) {
  if (folder.resume || folder.overwrite) return;
  std::error_code ignored;
  for (const path& manifest : ListManifests(folder.out)) {
    if (folder.shard.IsAll() && ReadManifestText(manifest).CountTasks() > 0) {
      FailByFormerRun(manifest);
    }
  }
  if (form.results.empty()) return;
  const path results = folder.out / form.results.front();
  if (std::filesystem::exists(results, ignored)) FailByFormerRun(results);
}

TaskJob::TaskJob(const std::vector<std::string>& names, const std::string& header, JobFolder folder,
                 JobForm form)
    : folder_(std::move(folder)),
      form_(std::move(form)),
      file_(ManifestPath(folder_.out, folder_.shard)) {
  RequireWritable(file_);  // the folder must be there to be locked
  lock_ =
      std::make_unique<FolderLock>(folder_.out, folder_.shard.IsAll() ? FolderLock::Mode::kExclusive
                                                                      : FolderLock::Mode::kShared);
  for (const std::string& name : names) {
    keys_.push_back(HexText(HashBytes64(fmt::format("{}\n{}", header, name))));
  }
  RefuseIfAppended(file_);
  TakeFormerRuns(header);
}

TaskJob::~TaskJob() = default;

void TaskJob::TakeFormerRuns(const std::string& header) {
  RefuseFormerRun(folder_, form_);
  for (const path& manifest : ListManifests(folder_.out)) {
    const ManifestText there = ReadManifestText(manifest);
    const bool same = there.header == header;
    const bool beside = IsManifestOfOtherShard(manifest, folder_.shard) && same;
    if (beside || folder_.overwrite || there.CountTasks() == 0) continue;
    if (!folder_.resume) FailByFormerRun(manifest);
    if (same) continue;
    throw InputError(manifest,
                     fmt::format("the run that is to go on had other options or inputs ({})",
                                 HeaderDifference(there.header, header)));
  }
  manifest_.header = header;
  if (folder_.overwrite && folder_.shard.IsAll()) return;
  TaskManifest all = ReadAll(header);
  manifest_.facts = std::move(all.facts);
  if (!folder_.resume) return;
  for (size_t i = 0; i < keys_.size(); ++i) {
    if (folder_.shard.Contains(i) && Holds(all, i)) {
      manifest_.records.insert(*all.records.find(keys_[i]));
    }
  }
}

bool TaskJob::Holds(const TaskManifest& manifest, size_t task) const {
  const auto record = manifest.records.find(keys_[task]);
  return record != manifest.records.end() && record->second.place == task;
}

// Other shards of the same run may be at work.
void TaskJob::RemoveFormerRun() const {
  std::error_code ignored;
  for (const path& manifest : ListManifests(folder_.out)) {
    const bool same =
        !folder_.shard.IsAll() && ReadManifestText(manifest).header == manifest_.header;
    if (!same) std::filesystem::remove(manifest, ignored);
  }
  if (!ListManifests(folder_.out).empty()) return;
  for (const std::string& name : form_.results) {
    std::filesystem::remove(folder_.out / name, ignored);
  }
}

// Without manifests of other runs, and without those that another shard, which is the last one to
// end, is just removing.
TaskManifest TaskJob::ReadAll(const std::string& header) const {
  TaskManifest all;
  for (const path& file : ListManifests(folder_.out)) {
    TaskManifest part = ReadTaskManifest(file, form_.is_readable);
    if (part.header == header) AddPart(std::move(part), all);
  }
  return all;
}

void TaskJob::Begin(const std::optional<std::string>& facts) {
  RefuseIfAppended(file_);
  if (folder_.overwrite) RemoveFormerRun();
  RemoveLeftTemporaries(folder_.out);
  manifest_.facts = facts;
  WriteTaskManifest(file_, manifest_);
  appender_ = std::make_unique<ManifestAppender>(file_);
}

std::vector<size_t> TaskJob::Missing() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::vector<size_t> missing;
  for (size_t i = 0; i < keys_.size(); ++i) {
    if (folder_.shard.Contains(i) && !manifest_.records.contains(keys_[i])) missing.push_back(i);
  }
  return missing;
}

void TaskJob::Add(size_t task, const std::string& line) {
  appender_->Append(line);
  const std::lock_guard<std::mutex> lock(mutex_);
  manifest_.records.insert_or_assign(keys_[task], TaskRecord{task, line});
}

std::optional<TaskManifest> TaskJob::Whole() const {
  TaskManifest all = folder_.shard.IsAll() ? manifest_ : ReadAll(manifest_.header);
  for (size_t i = 0; i < keys_.size(); ++i) {
    if (!Holds(all, i)) return std::nullopt;
  }
  return all;
}

void TaskJob::Finish(const TaskManifest& whole) {
  appender_.reset();
  WriteWholeManifest(folder_.out, whole);
}

}  // namespace raylift
