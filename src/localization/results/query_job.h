// A run of localization as a job (jobs/task_job.h): its tasks are the queries.

#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "localization/continuous/joined_references.h"

#include "raylift/jobs/task_job.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/result_files.h"
#include "raylift/localization/scene_calibration.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The manifest of a run of localization (jobs/task_job.h): a line of facts that all queries share,
// then a line for each query that is done. Results follow from it alone.

// The facts that all shards share.
struct RunFacts {
  size_t num_references = 0;
  std::vector<GeometrySummary> geometry;
  std::vector<std::string> warnings;  // of the scene's files
  bool checks_geometry = false;       // for RunWarnings()
  SceneCalibration calibration;
  std::vector<std::string> input_warnings;  // of how the input is read (LocalizeAll)
  std::vector<PromisedFile> files = {};     // what was written of the scene
};

struct QueryRecord {
  size_t place = 0;               // in the list
  std::string key = {};           // of all that its results depend on
  LocalizedQuery localized = {};  // as its diagnostics tell it
  std::string diagnostics = {};   // its line of queries.jsonl, without the line's end
  // Warnings of its matches, and of those of queries whose records are still to come.
  std::vector<std::string> warnings = {};
  std::optional<double> log_focal_factor = std::nullopt;
  // In continuous localization this is the reference that the query has become; nullopt where it
  // has become none.
  std::optional<JoinedReference> joined = std::nullopt;
  std::vector<PromisedFile> files = {};  // of its own
};

// Return lines of the manifest, without their ends.
std::string ToJsonLine(const RunFacts& facts);
std::string ToJsonLine(const QueryRecord& record);

// Returns whether the line is of one of the two kinds.
bool IsReadableLine(const std::string& line);

// Return what a manifest of readable lines holds; names are as UTF-8 has them.
std::optional<RunFacts> FactsOf(const TaskManifest& manifest);
// Returns the records in the order of the list. All warnings are in the first record, so that the
// order of the work does not show.
std::vector<QueryRecord> RecordsOf(const TaskManifest& manifest);
// Returns the manifest of a whole run, with these records. Their times are written by WriteTiming()
// alone.
TaskManifest WithRecords(TaskManifest manifest, std::span<const QueryRecord> records);

// Returns what the whole run has to say to its user, from records of all queries.
std::vector<std::string> AllWarnings(const RunFacts& facts, std::span<const QueryRecord> records);

// Writes poses.txt, queries.jsonl, summary.json and timing.jsonl from the records of all queries.
void WriteResults(const std::filesystem::path& out, const RunFacts& facts,
                  std::span<const QueryRecord> records, const std::optional<RunTimes>& times);

// Returns the form of a job with results in that folder.
JobForm QueryJobForm(const std::filesystem::path& out);

// The names of the files of a smoothed walk's trajectory.
struct TrajectoryFiles {
  std::string poses, covariances;
};
// Returns the names for a walk: `number` counts the walks of a list from 1 on; 0 is a walk by
// itself.
TrajectoryFiles TrajectoryFilesOf(size_t number);
inline constexpr const char* kWalkFile = "walk.json";

// Returns the names of the files of smoothed walks that a run has left there; the last is
// walk.json, which tells which there are.
std::vector<std::string> WalkFilesIn(const std::filesystem::path& out);

class QueryJob {
 public:
  // Takes `header`, JSON of all that the results depend on. Throws as TaskJob's constructor does.
  QueryJob(std::span<const Query> queries, const std::string& header, const JobFolder& folder);

  // Returns the facts as this or another run of the same header has found them; nullopt: none has.
  const std::optional<RunFacts>& facts() const { return facts_; }
  // Begins the manifest, before the first Add(), as TaskJob::Begin() does.
  void Begin(const RunFacts& facts);

  // Returns the queries of this shard that are not done.
  std::vector<size_t> Missing() const { return job_.Missing(); }

  // Returns what the queries of this shard that are done have become, by their places in the list.
  std::map<size_t, std::optional<JoinedReference>> Joined() const;

  // Records that a query is done and its files are written. The place, the key and the name of its
  // record are set here, and its warnings are those of all matches so far. Thread safe.
  void Add(size_t query, QueryRecord record);

  // Returns the records of all shards, in the order of the list, once all are done; nullopt before.
  // Throws as TaskJob::Whole() does.
  std::optional<std::vector<QueryRecord>> Whole();
  // Returns MachineWarnings() of what Whole() gave; to be called after it.
  std::vector<std::string> machine_warnings() const { return MachineWarnings(whole_); }
  // Makes the manifest that of the whole run; to be called after Whole(), when the results are
  // written.
  void Finish(std::span<const std::filesystem::path> results);

 private:
  // Takes the names as they are in the list, where they need not be UTF-8.
  void TakeNames(QueryRecord& record) const;

  std::vector<std::string> names_;  // of the queries
  TaskJob job_;
  std::optional<RunFacts> facts_;
  TaskManifest whole_;          // of Whole()
  std::mutex mutex_;            // guards what follows
  std::set<std::string> told_;  // warnings that are in a record
};

}  // namespace raylift
