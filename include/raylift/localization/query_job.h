// A run of localization that keeps its results as they come: in a folder, by itself or side by side
// with the other shards of the run, and so that a killed run goes on where it was. Whatever happens
// in between, the results are those of one run that was left alone.

#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "raylift/jobs/folder_lock.h"
#include "raylift/jobs/manifest_file.h"
#include "raylift/jobs/shard.h"
#include "raylift/localization/query_manifest.h"
#include "raylift/scene/query.h"

namespace raylift {

struct QueryJobOptions {
  std::filesystem::path out;
  Shard shard = {};
  bool resume = false;  // keep what former runs have left
  // Begin anew where there was a former run. With neither of the two its folder is refused.
  bool overwrite = false;
};

// OptionError where the folder holds a former run, as far as can be told without its header (shards
// work side by side), and `options` do not say what is to become of it.
void RefuseFormerRun(const QueryJobOptions& options);

class QueryJob {
 public:
  // `header`: JSON of all that the results depend on. OptionError as above; InputError where
  // `resume` finds a run of another header, naming what differs, or another run is at work.
  QueryJob(std::span<const Query> queries, const std::string& header,
           const QueryJobOptions& options);

  // As this or another run of the same header has found them; none: nobody has.
  const std::optional<RunFacts>& facts() const { return manifest_.facts; }
  // Before the first Add(): from now on there is a manifest. What was there before stays until
  // then. OutputError where it cannot be written, InputError where another run is at work.
  void Begin(const RunFacts& facts);

  // The queries of this shard that are not done.
  std::vector<size_t> Missing() const;

  // A query is done. `warnings` are those of all matches so far. Thread safe.
  void Add(size_t query, const LocalizedQuery& localized, const std::vector<std::string>& warnings,
           const std::optional<double>& log_focal_factor);

  // The records of all shards, in the order of the list, once all are done; then the manifest is
  // that of the whole run. None before.
  std::optional<std::vector<QueryRecord>> Finish();

 private:
  void TakeFormerRuns(const std::string& header);
  void RemoveFormerRun() const;
  QueryManifest ReadAll(const std::string& header) const;

  QueryJobOptions options_;
  std::vector<std::string> names_, keys_;  // of the queries
  std::filesystem::path file_;
  FolderLock lock_;
  QueryManifest manifest_;      // of this shard
  std::mutex mutex_;            // guards what follows and the manifest's records
  std::set<std::string> told_;  // warnings that are in a record
  std::unique_ptr<ManifestAppender> appender_;
};

// The records of `files`, which must all be of one run, with its header and facts. InputError
// naming the file where one is of another run.
QueryManifest ReadQueryManifests(std::span<const std::filesystem::path> files);

// To `out`, whose manifests of shards are no longer needed.
void WriteWholeManifest(const std::filesystem::path& out, const QueryManifest& manifest);

}  // namespace raylift
