#include "raylift/jobs/task_job.h"

#include <utility>

#include "base/hash.h"
#include "base/json_text.h"
#include "jobs/manifest_file.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

using std::filesystem::path;

[[noreturn]] void FailByFormerRun(const path& file) {
  throw OptionError(
      "overwrite", "false",
      fmt::format("{} is of a former run; resume = true keeps what is done", file.string()));
}

// The same line for a task that is at another place of the list now.
std::string AtPlace(const std::string& line, size_t place) {
  auto json = nlohmann::ordered_json::parse(line);
  json["place"] = place;
  return JsonText(json);
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
  lock_ = std::make_unique<FolderLock>(
      folder_.out, folder_.shard.IsAll() ? FolderLock::Mode::kExclusive : FolderLock::Mode::kShared,
      folder_.wait ? FolderLock::IfHeld::kWait : FolderLock::IfHeld::kFail);
  keys_ = form_.keys;
  RAYLIFT_CHECK(keys_.empty() || keys_.size() == names.size());
  for (size_t i = keys_.size(); i < names.size(); ++i) {
    const std::string& name = names[i];
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
    if (same || GoesOnAnyway()) continue;
    throw InputError(manifest,
                     fmt::format("the run that is to go on had other options or inputs ({})",
                                 HeaderDifference(there.header, header)));
  }
  manifest_.header = header;
  if (folder_.overwrite && folder_.shard.IsAll()) return;
  TaskManifest all = ReadAll(header);
  manifest_.facts = std::move(all.facts);
  if (!folder_.resume) return;
  std::vector<size_t> kept;
  for (size_t i = 0; i < keys_.size(); ++i) {
    if (folder_.shard.Contains(i) && TakeRecord(i, all, manifest_)) kept.push_back(i);
  }
  KeepWithFiles(kept, JobForm::Look::kContents, manifest_);
}

// The list of tasks may have become another one.
bool TaskJob::TakeRecord(size_t task, const TaskManifest& from, TaskManifest& to) const {
  const auto record = from.records.find(keys_[task]);
  if (record == from.records.end()) return false;
  const auto& [place, line] = record->second;
  if (place != task && !GoesOnAnyway()) return false;
  to.records.emplace(keys_[task], TaskRecord{task, place == task ? line : AtPlace(line, task)});
  return true;
}

void TaskJob::KeepWithFiles(const std::vector<size_t>& tasks, JobForm::Look look,
                            TaskManifest& manifest) const {
  if (!form_.has_files) return;
  std::vector<char> has_files(tasks.size());
  ParallelFor(tasks.size(), form_.threads, [&](size_t i) {
    const std::string& line = manifest.records.at(keys_[tasks[i]]).line;
    has_files[i] = form_.has_files(tasks[i], line, look) ? 1 : 0;
  });
  for (size_t i = 0; i < tasks.size(); ++i) {
    if (has_files[i] == 0) manifest.records.erase(keys_[tasks[i]]);
  }
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

// Leaves out the manifests of other runs that this one does not go on from, and those that another
// shard, which is the last one to end, is just removing.
TaskManifest TaskJob::ReadAll(const std::string& header) const {
  TaskManifest all;
  for (const path& file : ListManifests(folder_.out)) {
    TaskManifest part = ReadTaskManifest(file, form_.is_readable);
    if (part.header == header || GoesOnAnyway()) AddPart(std::move(part), all);
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
  if (folder_.shard.IsAll()) {
    return manifest_.records.size() == keys_.size() ? std::optional(manifest_) : std::nullopt;
  }
  TaskManifest all = ReadAll(manifest_.header);
  TaskManifest whole{manifest_.header, std::move(all.facts), {}};
  std::vector<size_t> tasks(keys_.size());
  for (size_t i = 0; i < keys_.size(); ++i) {
    if (!TakeRecord(i, all, whole)) return std::nullopt;
    tasks[i] = i;
  }
  KeepWithFiles(tasks, JobForm::Look::kSizes, whole);
  return whole.records.size() == keys_.size() ? std::optional(std::move(whole)) : std::nullopt;
}

void TaskJob::Finish(const TaskManifest& whole) {
  appender_.reset();
  WriteWholeManifest(folder_.out, whole);
}

}  // namespace raylift
