#include "raylift/localization/query_job.h"

#include <utility>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/hash.h"

namespace raylift {
namespace {

using std::filesystem::path;

[[noreturn]] void FailByFormerRun(const path& file) {
  throw OptionError(
      "overwrite", "false",
      fmt::format("{} is of a former run; resume = true keeps what is done", file.string()));
}

// The folder must be there to be locked.
const path& Writable(const path& out, const path& file) {
  RequireWritable(file);
  return out;
}

void Merge(QueryManifest more, QueryManifest& all) {
  all.header = more.header;
  if (more.facts) all.facts = std::move(more.facts);
  for (auto& [key, record] : more.records) all.records.insert_or_assign(key, std::move(record));
}

}  // namespace

void RefuseFormerRun(const QueryJobOptions& options) {
  if (options.resume || options.overwrite) return;
  std::error_code ignored;
  for (const path& manifest : ListManifests(options.out)) {
    if (options.shard.IsAll() && ReadManifestText(manifest).CountTasks() > 0) {
      FailByFormerRun(manifest);
    }
  }
  const path results = options.out / "queries.jsonl";
  if (std::filesystem::exists(results, ignored)) FailByFormerRun(results);
}

QueryJob::QueryJob(std::span<const Query> queries, const std::string& header,
                   const QueryJobOptions& options)
    : options_(options),
      file_(ManifestPath(options.out, options.shard)),
      lock_(Writable(options.out, file_),
            options.shard.IsAll() ? FolderLock::Mode::kExclusive : FolderLock::Mode::kShared) {
  for (const Query& query : queries) {
    names_.push_back(query.name);
    keys_.push_back(HexText(HashBytes64(fmt::format("{}\n{}", header, query.name))));
  }
  RefuseIfAppended(file_);
  TakeFormerRuns(header);
}

void QueryJob::TakeFormerRuns(const std::string& header) {
  RefuseFormerRun(options_);
  for (const path& manifest : ListManifests(options_.out)) {
    const ManifestText there = ReadManifestText(manifest);
    const bool same = there.header == header;
    const bool beside = IsManifestOfOtherShard(manifest, options_.shard) && same;
    if (beside || options_.overwrite || there.CountTasks() == 0) continue;
    if (!options_.resume) FailByFormerRun(manifest);
    if (same) continue;
    throw InputError(manifest,
                     fmt::format("the run that is to go on had other options or inputs ({})",
                                 HeaderDifference(there.header, header)));
  }
  manifest_.header = header;
  if (options_.overwrite && options_.shard.IsAll()) return;
  QueryManifest all = ReadAll(header);
  manifest_.facts = std::move(all.facts);
  if (!options_.resume) return;
  for (size_t i = 0; i < keys_.size(); ++i) {
    const auto record = all.records.find(keys_[i]);
    if (record == all.records.end() || !options_.shard.Contains(i)) continue;
    told_.insert(record->second.warnings.begin(), record->second.warnings.end());
    manifest_.records.insert(*record);
  }
}

// Other shards of the same run may be at work.
void QueryJob::RemoveFormerRun() const {
  std::error_code ignored;
  for (const path& manifest : ListManifests(options_.out)) {
    const bool same =
        !options_.shard.IsAll() && ReadManifestText(manifest).header == manifest_.header;
    if (!same) std::filesystem::remove(manifest, ignored);
  }
  if (!ListManifests(options_.out).empty()) return;
  for (const char* name : {"poses.txt", "queries.jsonl", "summary.json"}) {
    std::filesystem::remove(options_.out / name, ignored);
  }
}

QueryManifest QueryJob::ReadAll(const std::string& header) const {
  QueryManifest all;
  for (const path& file : ListManifests(options_.out)) {
    QueryManifest manifest = ReadQueryManifest(file);
    if (manifest.header == header) Merge(std::move(manifest), all);
  }
  return all;
}

void QueryJob::Begin(const RunFacts& facts) {
  RefuseIfAppended(file_);
  if (options_.overwrite) RemoveFormerRun();
  manifest_.facts = facts;
  WriteQueryManifest(file_, manifest_);
  appender_ = std::make_unique<ManifestAppender>(file_);
}

std::vector<size_t> QueryJob::Missing() const {
  std::vector<size_t> missing;
  for (size_t i = 0; i < keys_.size(); ++i) {
    if (options_.shard.Contains(i) && !manifest_.records.contains(keys_[i])) missing.push_back(i);
  }
  return missing;
}

void QueryJob::Add(size_t query, const LocalizedQuery& localized,
                   const std::vector<std::string>& warnings,
                   const std::optional<double>& log_focal_factor) {
  QueryRecord record{.place = query, .key = keys_[query]};
  record.diagnostics = FormatQueryDiagnostics(localized);
  // As it would be read back, so that it does not show who has localized it.
  record.localized = ParseQueryDiagnostics(record.diagnostics, names_[query]);
  record.log_focal_factor = log_focal_factor;
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const std::string& warning : warnings) {
    if (told_.insert(warning).second) record.warnings.push_back(warning);
  }
  appender_->Append(ToJsonLine(record));
  manifest_.records.insert_or_assign(record.key, std::move(record));
}

std::optional<std::vector<QueryRecord>> QueryJob::Finish() {
  QueryManifest all = options_.shard.IsAll() ? manifest_ : ReadAll(manifest_.header);
  for (size_t i = 0; i < keys_.size(); ++i) {
    const auto record = all.records.find(keys_[i]);
    if (record == all.records.end()) return std::nullopt;
    // As it is in the list, where it need not be UTF-8.
    record->second.localized.name = names_[i];
  }
  appender_.reset();
  WriteWholeManifest(options_.out, all);
  return InOrder(all.records);
}

void WriteWholeManifest(const path& out, const QueryManifest& manifest) {
  const path whole = ManifestPath(out, {});
  WriteQueryManifest(whole, manifest);
  for (const path& part : ListManifests(out)) {
    std::error_code ignored;
    if (part != whole) std::filesystem::remove(part, ignored);
  }
}

QueryManifest ReadQueryManifests(std::span<const path> files) {
  QueryManifest all;
  for (const path& file : files) {
    QueryManifest manifest = ReadQueryManifest(file);
    if (!all.header.empty() && manifest.header != all.header) {
      throw InputError(file, fmt::format("is of another run than {} ({})", files.front().string(),
                                         HeaderDifference(all.header, manifest.header)));
    }
    Merge(std::move(manifest), all);
  }
  return all;
}

}  // namespace raylift
