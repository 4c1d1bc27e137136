#include "localization/fields.h"

#include "lifting/fields.h"

namespace raylift {

std::vector<Field> FieldsOf(StageCounts& counts) {
  std::vector<Field> fields = {
      {"retrieved", counts.retrieved, "References"},
      {"matched", counts.matched, "2D-2D matches"},
      {"hit", counts.hit, "Matches that were lifted to the scene"},
  };
  const std::vector<Field> filter = FieldsOf(counts.filter);
  fields.insert(fields.end(), filter.begin(), filter.end());
  fields.insert(fields.end(), {{"points", counts.points, "2D-3D matches of the estimate"},
                               {"inliers_2d3d", counts.inliers_2d3d, "2D-3D inliers"},
                               {"inliers_2d2d", counts.inliers_2d2d, "2D-2D inliers"}});
  return fields;
}

std::vector<Field> FieldsOf(JoinGateOptions& options) {
  return {
      {"join_min_inliers_2d2d", options.min_inliers_2d2d, "To join, a query needs so many",
       kNotNegative},
      {"join_min_inliers_2d3d", options.min_inliers_2d3d,
       "The same of 2D-3D inliers, where there is geometry", kNotNegative},
      {"join_max_rotation_sigma_deg", options.max_rotation_sigma_deg,
       "Largest standard deviation of its rotation", kPositive},
      {"join_max_position_sigma", options.max_position_sigma,
       "The same of its position, scene units (default: 2 % of the distance\n"
       "to what it sees)",
       kPositive},
      {"join_max_difference_deg", options.max_difference_deg,
       "Largest difference of its poses by P3P alone and by E5+1 alone", kPositive},
      {"join_max_difference_position", options.max_difference_position,
       "The same of the positions, scene units (default: 5 % of the distance)", kPositive},
  };
}

}  // namespace raylift
