// One table of results in three forms. A number is rounded once, so that all forms hold the same.

#pragma once

#include <span>
#include <string>

#include "raylift/evaluation/pose_errors.h"

namespace raylift {

// The summaries must be of the same thresholds.
struct ResultTable {
  std::span<const Threshold> thresholds;
  std::span<const ResultSummary> results;
};

// Aligned columns for reading. Results that use the ground truth are marked by a star. After it,
// for the results that have one, their calibration.
std::string FormatTableText(const ResultTable& table);

// RFC 4180 with one header line. An infinite median is `inf`.
std::string FormatTableCsv(const ResultTable& table);

// {"thresholds": [{position, rotation_deg}], "results": [{name, uses_ground_truth, queries,
// localized, unknown, recalls_percent: [...], median_position, median_rotation_deg, missing_names,
// unknown_names, calibration: {poses, mean_normalized_square, median_normalized_square,
// coverage_90_percent, median_sigmas, below_3_sigma_percent}}]}, the last where it is known. An
// infinite median is null, as JSON has no such number.
std::string FormatTableJson(const ResultTable& table);

}  // namespace raylift
