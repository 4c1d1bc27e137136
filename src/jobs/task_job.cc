#include "raylift/jobs/task_job.h"

#include <utility>

#include "base/hash.h"
#include "base/instruction_sets.h"
#include "base/json_text.h"
#include "jobs/file_promises.h"
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

// Returns the same line for a task that is at another place of the list now.
std::string AtPlace(const std::string& line, size_t place) {
  auto json = nlohmann::ordered_json::parse(line);
  json["place"] = place;
  return JsonText(json);
}

}  // namespace

void RefuseFormerRun(const JobFolder& folder, const JobForm& form) {
  if (folder.resume || folder.overwrite) return;
  for (const path& manifest : ListManifests(folder.out)) {
    if (folder.shard.IsAll() && ReadManifestText(manifest).CountTasks() > 0) {
      FailByFormerRun(manifest);
    }
  }
  if (form.results.empty()) return;
  const path results = folder.out / form.results.front();
  if (Exists(results)) FailByFormerRun(results);
}

void RemoveFormerRun(const path& out, const JobForm& form, const std::string& kept) {
  std::error_code ignored;
  for (const path& manifest : ListManifests(out)) {
    const bool is_kept = !kept.empty() && ReadManifestText(manifest).header == kept;
    if (!is_kept) std::filesystem::remove(manifest, ignored);
  }
  if (!ListManifests(out).empty()) return;
  for (const std::string& name : form.results) std::filesystem::remove(out / name, ignored);
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
  if (all.facts && KeepsPromise(folder_.out, *all.facts, FileCheck::kContents)) {
    manifest_.facts = std::move(all.facts);
  }
  if (!folder_.resume) return;
  if (!folder_.shard.IsAll()) {
    manifest_.instructions = ReadTaskManifest(file_, form_.is_readable).instructions;
  }
  for (size_t i = 0; i < keys_.size(); ++i) {
    if (folder_.shard.Contains(i)) TakeRecord(i, all, manifest_);
  }
  for (const size_t task : WithoutFiles(manifest_, FileCheck::kContents)) {
    manifest_.records.erase(keys_[task]);
  }
}

// Takes a record over; the list of tasks may have changed.
bool TaskJob::TakeRecord(size_t task, const TaskManifest& from, TaskManifest& to) const {
  const auto record = from.records.find(keys_[task]);
  if (record == from.records.end()) return false;
  const auto& [place, line] = record->second;
  if (place != task && !GoesOnAnyway()) return false;
  to.records.emplace(keys_[task], TaskRecord{task, place == task ? line : AtPlace(line, task)});
  return true;
}

std::vector<size_t> TaskJob::WithoutFiles(const TaskManifest& manifest, FileCheck check) const {
  std::vector<const TaskRecord*> records;
  records.reserve(manifest.records.size());
  for (const auto& [key, record] : manifest.records) records.push_back(&record);
  std::vector<char> has_files(records.size());
  ParallelFor(records.size(), form_.threads, [&](size_t i) {
    has_files[i] = KeepsPromise(folder_.out, records[i]->line, check) ? 1 : 0;
  });
  std::vector<size_t> without;
  for (size_t i = 0; i < records.size(); ++i) {
    if (has_files[i] == 0) without.push_back(records[i]->place);
  }
  return without;
}

// Requires all files that this run has promised, except the results.
void TaskJob::RequireFiles() const {
  std::vector<PromisedFile> files = FilesOfLine(manifest_.facts.value_or(""));
  for (const auto& [key, record] : manifest_.records) {
    for (PromisedFile& file : FilesOfLine(record.line)) files.push_back(std::move(file));
  }
  constexpr size_t kNamed = 3;
  std::string named;
  size_t faults = 0;
  for (const PromisedFile& file : files) {
    const auto fault = FaultOf(folder_.out, file, FileCheck::kSizes);
    if (fault && ++faults <= kNamed) named += fmt::format("; {} {}", file.path, *fault);
  }
  if (faults == 0) return;
  throw OutputError(folder_.out,
                    fmt::format("{} of {} files are no longer as this run has written them{}{}",
                                faults, files.size(), named, faults > kNamed ? "; ..." : ""));
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
  if (folder_.overwrite) {
    // Other shards of the same run may be at work.
    RemoveFormerRun(folder_.out, form_, folder_.shard.IsAll() ? std::string() : manifest_.header);
  }
  RemoveLeftTemporaries(folder_.out);
  manifest_.facts = facts;
  manifest_.instructions.insert(std::string(VectorInstructions()));
  WriteTaskManifest(file_, manifest_);
  appender_ = std::make_unique<ManifestAppender>(file_);
}

std::vector<size_t> TaskJob::Missing() const {
  if (appender_) appender_->Flush();
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
  if (appender_) appender_->Flush();
  RequireFiles();
  if (folder_.shard.IsAll()) {
    return manifest_.records.size() == keys_.size() ? std::optional(manifest_) : std::nullopt;
  }
  std::optional<TaskManifest> whole = WholeOfShards();
  // The last shard to end makes one manifest of all.
  if (!whole && appender_ && !Exists(ManifestPath(folder_.out, {}))) {
    appender_->RequireInPlace();
  }
  return whole;
}

std::optional<TaskManifest> TaskJob::WholeOfShards() const {
  TaskManifest all = ReadAll(manifest_.header);
  TaskManifest whole;
  whole.header = manifest_.header;
  whole.facts = std::move(all.facts);
  whole.instructions = std::move(all.instructions);
  for (size_t i = 0; i < keys_.size(); ++i) {
    if (!TakeRecord(i, all, whole)) return std::nullopt;
  }
  if (!WithoutFiles(whole, FileCheck::kSizes).empty()) return std::nullopt;
  return whole;
}

void TaskJob::Finish(TaskManifest whole, std::span<const path> results) {
  appender_.reset();
  whole.results = PromiseFiles(folder_.out, results);
  WriteWholeManifest(folder_.out, whole);
}

}  // namespace raylift
