// How far estimated poses are from the true ones, query by query.

#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "raylift/geometry/rigid3.h"

namespace raylift {

struct PoseError {
  double position;      // distance of the camera centers, in scene units
  double rotation_deg;  // angle of the rotation between the orientations
};

PoseError ComparePoses(const Rigid3& estimated_cam_from_world, const Rigid3& true_cam_from_world);

// cam_from_world by image name.
using PosesByName = std::map<std::string, Rigid3>;

struct QueryError {
  std::string name;                // the ground truth's
  std::optional<PoseError> error;  // none: not localized
};

// One method's poses against the ground truth.
struct Comparison {
  std::vector<QueryError> queries;         // every query of the ground truth, by name
  std::vector<std::string> unknown_names;  // estimated, but not in the ground truth
  bool uses_ground_truth = false;          // an oracle's: not a method one could run
};

// Names match exactly; else an estimate's name may be the end of one true name, from a `/` on
// (hloc's result files hold `image.png` or `seq/image.png` for `dir/seq/image.png`), where it is
// the only such estimate, fits no other true name and that one has no exact estimate. A non-finite
// pose counts as not localized.
Comparison CompareWithGroundTruth(const PosesByName& ground_truth, const PosesByName& estimated);

// The estimated poses under the names of the ground truth, by the same rule; unknown ones are left
// out.
PosesByName MatchNames(const PosesByName& ground_truth, const PosesByName& estimated);

// The comparison of each group of queries (such as day and night), by the group's name. Queries
// that `group_of_query` does not know are in none, unknown names neither.
std::map<std::string, Comparison> SplitByGroup(
    const Comparison& comparison, const std::map<std::string, std::string>& group_of_query);

// The paper's Oracle: of two methods' poses of a query, the one with the smaller
// max(position error in cm, rotation error in deg). An upper bound for choosing between them, made
// with the ground truth. Both comparisons must be with the same ground truth.
Comparison ChooseByOracle(const Comparison& a, const Comparison& b, double cm_per_scene_unit = 100);

}  // namespace raylift
