// Files that a run of localization leaves behind: poses, diagnostics per query, a summary.

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

// `poses.txt`: localized queries in the given order.
void WritePoses(const std::filesystem::path& path, const std::vector<LocalizedQuery>& queries);

// `queries.jsonl`: one JSON object per query: name, status, reason, verdict, confidence, counts of
// each stage, solver, scores, iterations, pose, covariance.
void WriteQueryDiagnostics(const std::filesystem::path& path, std::span<const std::string> lines);

// A line of it, without the line's end.
std::string FormatQueryDiagnostics(const LocalizedQuery& query);

// The queries of such a file, with all that it says of them. Throws InputError naming the line
// where it is none.
std::vector<LocalizedQuery> ReadQueryDiagnostics(const std::filesystem::path& path);

// `depth_alignment.jsonl`: one JSON object per aligned source and reference: how its depth was
// corrected, on how many matches that rests, how far these were from the projected keypoints before
// and after.
void WriteAlignment(const std::filesystem::path& path, std::span<const SceneSource> geometry);

// What rendering again from the estimated poses did (localization/rerender.h).
struct RerenderCounts {
  bool asked = false;
  size_t improved = 0;  // queries
  size_t rounds_kept = 0;
};
RerenderCounts CountRerendered(std::span<const LocalizedQuery> queries);

// The queries that are not localized, then the doubtful ones, the least confident first.
std::vector<const LocalizedQuery*> NotLocalizedOrDoubtful(std::span<const LocalizedQuery> queries);

// `summary.json`: totals, geometry, medians of the stages' counts, what the queries' matches have
// in common, warnings.
struct GeometrySummary {
  std::string spec, interpretation;
  struct Alignment {
    std::string mode;  // what was done: off, scale, affine, grid
    double median_factor = 1, median_before_px = 0, median_after_px = 0;
  };
  std::optional<Alignment> alignment = std::nullopt;
};
std::vector<GeometrySummary> SummaryOf(std::span<const SceneSource> geometry);

// How long a run took, in seconds by the clock.
struct RunTimes {
  double reading = 0;   // what it was given
  double matching = 0;  // features, retrieval and matches, as far as not with each query
  double learning = 0;  // what its queries have in common: noise, alignment, checks
  double queries = 0;
  double writing = 0;  // of this, by all threads: problems, pictures, parts of the page
  double Total() const { return reading + matching + learning + queries; }
};
// `timing.jsonl`: one JSON object per query with the milliseconds of each stage, and one of the run
// that writes it: seconds by the clock, of each stage, and of all threads together. It alone holds
// times: the other files have the same bytes in every run.
void WriteTiming(const std::filesystem::path& path, std::span<const LocalizedQuery> queries,
                 const std::optional<RunTimes>& run);

// One line, with what all threads together took for each stage of the queries.
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
