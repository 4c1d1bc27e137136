// A comparison of depth sources as tables: the same numbers for reading, as CSV and as JSON.

#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/comparison/depth_comparison.h"

namespace raylift {

// A number that every image of a source has, or has not.
struct DepthMetric {
  enum class Better { kLow, kHigh, kNeither };
  std::string_view key;    // in CSV and JSON
  std::string_view title;  // for readers
  Better better;
  int digits;  // after the point
  std::function<std::optional<double>(const ImageComparison&)> value;
};
const std::vector<DepthMetric>& DepthMetrics();

// One row per source, the truth marked, and one line per finding.
std::string FormatComparisonText(const DepthComparison& comparison);

// Per source: the means over the images of every metric, and what is known of a source alone.
std::string FormatSourcesCsv(const DepthComparison& comparison);
// Per source and image.
std::string FormatImagesCsv(const DepthComparison& comparison);
// Errors by distance, incidence angle and distance to an edge, shares of matches by reprojection
// error, surface scores: source, curve, from, to, count, abs_rel, mae, bias, percent.
std::string FormatCurvesCsv(const DepthComparison& comparison);
// All of it.
std::string FormatComparisonJson(const DepthComparison& comparison);

}  // namespace raylift
