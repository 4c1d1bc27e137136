// Writes the files of a run of localization: poses, diagnostics per query, a summary.

#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/localization/localizer.h"
#include "raylift/localization/scene.h"

namespace raylift {

// Writes `poses.txt`: the localized queries in the given order.
void WritePoses(const std::filesystem::path& path, const std::vector<LocalizedQuery>& queries);

// Writes `queries.jsonl`: one JSON object per query with name, status, reason, verdict, confidence,
// counts of each stage, solver, scores, iterations, pose, covariance.
void WriteQueryDiagnostics(const std::filesystem::path& path, std::span<const std::string> lines);

// Returns a line of it, without the line's end.
std::string FormatQueryDiagnostics(const LocalizedQuery& query);

// Reads the queries of such a file, with all that it says of them. Throws InputError naming the
// line where it is none.
std::vector<LocalizedQuery> ReadQueryDiagnostics(const std::filesystem::path& path);

// Writes `depth_alignment.jsonl`: one JSON object per aligned source and reference with the
// correction of its depth, the number of matches that it rests on, and their distances from the
// projected keypoints before and after.
void WriteAlignment(const std::filesystem::path& path, std::span<const SceneSource> geometry);

// Counts of the refinement by rendering from the estimated poses (localization/rerender.h).
struct RerenderCounts {
  bool asked = false;
  size_t improved = 0;  // queries
  size_t rounds_kept = 0;
};
RerenderCounts CountRerendered(std::span<const LocalizedQuery> queries);

// Returns the queries that are not localized, then the doubtful ones, the least confident first.
std::vector<const LocalizedQuery*> NotLocalizedOrDoubtful(std::span<const LocalizedQuery> queries);

// Writes `summary.json`: totals, geometry, medians of the stages' counts, noise of the queries'
// matches, warnings.
struct GeometrySummary {
  std::string spec, interpretation;
  struct Alignment {
    std::string mode;  // what was done: off, scale, affine, grid
    double median_factor = 1, median_before_px = 0, median_after_px = 0;
  };
  std::optional<Alignment> alignment = std::nullopt;
};
std::vector<GeometrySummary> SummaryOf(std::span<const SceneSource> geometry);

// The times of a run in seconds of wall clock.
struct RunTimes {
  double reading = 0;   // what it was given
  double matching = 0;  // features, retrieval and matches, as far as not with each query
  double learning = 0;  // what its queries have in common: noise, alignment, checks
  double queries = 0;
  double writing = 0;  // of this, by all threads: problems, pictures, parts of the page
  double Total() const { return reading + matching + learning + queries; }
};
// Writes `timing.jsonl`: one JSON object per query with the milliseconds of each stage, and one of
// the run with the seconds of wall clock of each stage and of all threads together. Only this file
// holds times: the others have the same bytes in every run.
void WriteTiming(const std::filesystem::path& path, std::span<const LocalizedQuery> queries,
                 const std::optional<RunTimes>& run);

// Returns one line with the times of the stages, summed over all threads.
std::string Describe(const RunTimes& times, std::span<const LocalizedQuery> queries);

struct RunSummary {
  size_t num_references = 0;
  std::vector<GeometrySummary> geometry;
  std::vector<std::string> warnings;
  std::optional<SceneNoise> scene_noise = std::nullopt;
};
void WriteSummary(const std::filesystem::path& path, const std::vector<LocalizedQuery>& queries,
                  const RunSummary& summary);

}  // namespace raylift
