// A run of localization as a job (jobs/task_job.h): its tasks are the queries.

#pragma once

#include <cstddef>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "raylift/jobs/task_job.h"
#include "raylift/localization/query_manifest.h"
#include "raylift/scene/photographs.h"

namespace raylift {

JobForm QueryJobForm();

class QueryJob {
 public:
  // `header`: JSON of all that the results depend on. Throws as TaskJob's does.
  QueryJob(std::span<const Query> queries, const std::string& header, const JobFolder& folder);

  // As this or another run of the same header has found them; none: nobody has.
  const std::optional<RunFacts>& facts() const { return facts_; }
  // Before the first Add(), as TaskJob's.
  void Begin(const RunFacts& facts);

  // The queries of this shard that are not done.
  std::vector<size_t> Missing() const { return job_.Missing(); }

  // A query is done. `warnings` are those of all matches so far. Thread safe.
  void Add(size_t query, const LocalizedQuery& localized, const std::vector<std::string>& warnings,
           const std::optional<double>& log_focal_factor);

  // The records of all shards, in the order of the list, once all are done; then the manifest is
  // that of the whole run. None before.
  std::optional<std::vector<QueryRecord>> Finish();

 private:
  std::vector<std::string> names_;  // of the queries
  TaskJob job_;
  std::optional<RunFacts> facts_;
  std::mutex mutex_;            // guards what follows
  std::set<std::string> told_;  // warnings that are in a record
};

}  // namespace raylift
