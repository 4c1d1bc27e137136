// What a run of localization leaves behind: poses, diagnostics per query, a summary.

#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "raylift/localization/localizer.h"

namespace raylift {

// `poses.txt`: localized queries in the given order.
void WritePoses(const std::filesystem::path& path, const std::vector<LocalizedQuery>& queries);

// `queries.jsonl`: one JSON object per query: name, status, reason, counts of each stage, solver,
// scores, iterations, pose, covariance, milliseconds.
void WriteQueryDiagnostics(const std::filesystem::path& path,
                           const std::vector<LocalizedQuery>& queries);

// `summary.json`: totals, medians of the stages' counts, warnings, seconds.
struct RunSummary {
  size_t num_references = 0;
  std::vector<std::string> geometry;
  std::vector<std::string> warnings;
  double seconds = 0;
};
void WriteSummary(const std::filesystem::path& path, const std::vector<LocalizedQuery>& queries,
                  const RunSummary& summary);

}  // namespace raylift
