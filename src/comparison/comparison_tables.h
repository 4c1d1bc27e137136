// Writes a comparison of depth sources as tables: the same numbers for reading, as CSV and as JSON.

#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/comparison/depth_comparison.h"

namespace raylift {

// A metric of a source in an image; nullopt where the image does not have it.
struct DepthMetric {
  enum class Better { kLow, kHigh, kNeither };
  std::string key;    // in CSV and JSON
  std::string title;  // for readers
  Better better;
  int digits;  // after the point
  std::function<std::optional<double>(const ImageComparison&)> value;
  // Returns the value of all images together; where it is null, that is the mean over the images.
  // Metrics of matches count each match once: an image with a few wrong matches must not weigh as
  // much as one with thousands.
  std::function<std::optional<double>(const SourceComparison&)> pooled = nullptr;
};
const std::vector<DepthMetric>& DepthMetrics();

// Returns the metric of a source as a whole.
std::optional<double> ValueOfSource(const SourceComparison& source, const DepthMetric& metric);

// Returns one line: which source is best, for what, by which number; empty where there is no
// choice.
std::string Advice(const DepthComparison& comparison);

// Returns that line, one row per source, the truth marked, one line of findings each, and a table
// of the standard metrics for each of `protocols`.
std::string FormatComparisonText(const DepthComparison& comparison,
                                 std::span<const DepthProtocol> protocols = {});

// Returns a row per source: every metric of it as a whole, and what is known of a source alone.
std::string FormatSourcesCsv(const DepthComparison& comparison);
// Returns a row per source and image.
std::string FormatImagesCsv(const DepthComparison& comparison);
// Returns errors by distance, incidence angle and distance to an edge, shares of matches by
// reprojection error, surface scores: source, curve, from, to, count, abs_rel, mae, bias, percent.
std::string FormatCurvesCsv(const DepthComparison& comparison);
// Returns all of the comparison.
std::string FormatComparisonJson(const DepthComparison& comparison);

}  // namespace raylift
