#include "lifting/fields.h"

namespace raylift {

std::vector<Field> FieldsOf(ConsistencyThresholds& thresholds) {
  return {
      {"filter_reprojection_px", thresholds.reprojection_px,
       "A reference agrees where the point lands this close to\n"
       "the matched keypoint",
       kPositive},
      {"filter_min_views", thresholds.min_views,
       "References that must agree, the point's own included", kAtLeastOne},
      {"filter_min_ratio", thresholds.min_ratio,
       "Share that must agree of the references that observe\n"
       "the keypoint; 0: any",
       kShare},
  };
}

std::vector<Field> FieldsOf(FilterOptions& options) {
  std::vector<Field> fields = {
      {"filter", options.mode,
       "Drop lifted points that too few references agree on:\n"
       "{}. fixed helps noisy geometry and hurts accurate\n"
       "geometry; auto leaves accurate geometry alone and needs none\n"
       "of the options below"},
  };
  const std::vector<Field> thresholds = FieldsOf(options.thresholds);
  fields.insert(fields.end(), thresholds.begin(), thresholds.end());
  return fields;
}

std::vector<Field> FieldsOf(CandidateOptions& options) {
  return {
      {"candidates", options.mode,
       "The 3D points of a query keypoint, one per matched reference:\n"
       "{}. Keep all, merge them to one by the\n"
       "references' matched keypoints, or triangulate these and use no\n"
       "--geometry"},
      {"candidates_error_px", options.max_error_px,
       "A reference counts for a merged or triangulated point that\n"
       "projects this close to its keypoint",
       kPositive},
      {"candidates_min_angle_deg", options.min_angle_deg,
       "Smallest angle between rays that a point is triangulated or\n"
       "refined from",
       Range{.says = "must be at least 0 and below 90",
             .least = 0,
             .most = 90,
             .without_most = true}},
  };
}

std::vector<Field> FieldsOf(FilterCounts& counts) {
  return {
      {"consistent", counts.consistent, "Points that the filter keeps"},
      {"dropped_by_views", counts.dropped_by_views, "Points that too few references see"},
      {"dropped_by_ratio", counts.dropped_by_ratio, "Points that too many contradict"},
      {"dropped_by_error", counts.dropped_by_error, "Points too far off, by their views"},
      {"dropped_as_too_few", counts.dropped_as_too_few,
       "Consistent points, of which too few remain"},
  };
}

}  // namespace raylift
