// The field's figures of merit: the share of queries localized within error thresholds, and median
// errors. Both count every query of the ground truth: one without a pose has infinite errors.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/evaluation/calibration.h"
#include "raylift/evaluation/pose_errors.h"

namespace raylift {

struct Threshold {
  double position;  // scene units
  double rotation_deg;

  // Within both, or exactly at them.
  bool Accepts(const PoseError& error) const {
    return error.position <= position && error.rotation_deg <= rotation_deg;
  }
  bool operator==(const Threshold&) const = default;
};

// "0.05,5:0.1,1:0.25,2", that is position,degrees between colons, or the name of a data set, whose
// customary thresholds (in meters) they are. OptionError, in the name of "thresholds", on anything
// but positive finite numbers in pairs.
std::vector<Threshold> ParseThresholds(std::string_view text);
std::string ThresholdPresetNames();  // "aachen|robotcar|..."

struct ResultSummary {
  std::string name;
  bool uses_ground_truth = false;
  size_t num_queries = 0;  // in the ground truth
  size_t num_localized = 0;
  std::vector<double> recalls_percent;  // of all queries, one per threshold
  // Over all queries, as 7-Scenes reports them: infinite where half of the queries or more have no
  // pose. The mean of the middle two for an even count.
  double median_position = 0;
  double median_rotation_deg = 0;
  std::vector<std::string> missing_names;                 // queries without a pose
  std::vector<std::string> unknown_names;                 // poses without a query
  std::optional<Calibration> calibration = std::nullopt;  // where covariances are known
};

// InputError where the ground truth holds no queries.
ResultSummary Summarize(std::string name, const Comparison& comparison,
                        std::span<const Threshold> thresholds);

// One line for the user where poses were left out for not being in the ground truth; else empty.
std::string UnknownNamesWarning(const ResultSummary& summary);

}  // namespace raylift
