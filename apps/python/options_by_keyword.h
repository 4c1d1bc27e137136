// Options by keywords, with the names and defaults that they have on the command line.

#pragma once

#include "conversions.h"

#include "raylift/estimation/pose_estimator.h"
#include "raylift/lifting/candidates.h"
#include "raylift/lifting/consistency_filter.h"

namespace raylift::python {

inline void TakeEstimatorOptions(Keywords& keywords, EstimatorOptions& options) {
  keywords.Take("method", options.method);
  keywords.Take("score", options.score);
  keywords.Take("lo", options.local_optimization);
  keywords.Take("alpha", options.alpha);
  keywords.Take("refinement", options.refinement);
  keywords.Take("reprojection_threshold_px", options.reprojection_threshold_px);
  keywords.Take("sampson_threshold_px", options.sampson_threshold_px);
  keywords.Take("point_sigma", options.point_sigma);
  keywords.Take("refine_focal", options.refine_focal);
  keywords.Take("focal_range", options.focal_range);
  keywords.Take("min_iterations", options.min_iterations);
  keywords.Take("max_iterations", options.max_iterations);
  keywords.Take("confidence", options.confidence);
  keywords.Take("seed", options.seed);
}

inline void TakeFilterThresholds(Keywords& keywords, ConsistencyThresholds& thresholds) {
  keywords.Take("filter_reprojection_px", thresholds.reprojection_px);
  keywords.Take("filter_min_views", thresholds.min_views);
  keywords.Take("filter_min_ratio", thresholds.min_ratio);
}

inline void TakeCandidateOptions(Keywords& keywords, CandidateOptions& candidates) {
  keywords.Take("candidates", candidates.mode);
  keywords.Take("candidates_error_px", candidates.max_error_px);
  keywords.Take("candidates_min_angle_deg", candidates.min_angle_deg);
}

}  // namespace raylift::python
