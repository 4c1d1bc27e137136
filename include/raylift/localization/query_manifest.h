// What the manifest of a run of localization (jobs/task_manifest.h) says: what all queries have in
// common, then each query that is done. Results follow from it alone.

#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/jobs/task_job.h"
#include "raylift/localization/batch_localizer.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/result_files.h"

namespace raylift {

// The same in all shards.
struct RunFacts {
  size_t num_references = 0;
  std::vector<GeometrySummary> geometry;
  std::vector<std::string> warnings;  // of the scene's files
  bool checks_geometry = false;       // for RunWarnings()
  SceneKnowledge knowledge;
};

struct QueryRecord {
  size_t place = 0;               // in the list
  std::string key = {};           // of all that its results depend on
  LocalizedQuery localized = {};  // as ParseQueryDiagnostics() gives it
  std::string diagnostics = {};   // its line of queries.jsonl, without the line's end
  // Of its matches, and of those of queries whose records are still to come.
  std::vector<std::string> warnings = {};
  std::optional<double> log_focal_factor = std::nullopt;
};

// Lines of the manifest, without their ends.
std::string ToJsonLine(const RunFacts& facts);
std::string ToJsonLine(const QueryRecord& record);

// Of one of the two kinds.
bool IsReadableLine(const std::string& line);

// Of a manifest of readable lines; names are as UTF-8 has them.
std::optional<RunFacts> FactsOf(const TaskManifest& manifest);
// In the order of the list. All warnings are with the first record, so that it does not show which
// query was done first.
std::vector<QueryRecord> RecordsOf(const TaskManifest& manifest);
// The manifest with such records.
TaskManifest WithRecords(TaskManifest manifest, std::span<const QueryRecord> records);

// What the whole run has to say to its user, from records of all queries.
std::vector<std::string> AllWarnings(const RunFacts& facts, std::span<const QueryRecord> records);

// poses.txt, queries.jsonl, summary.json and timing.jsonl of records of all queries.
void WriteResults(const std::filesystem::path& out, const RunFacts& facts,
                  std::span<const QueryRecord> records, const std::optional<RunTimes>& times);

}  // namespace raylift
