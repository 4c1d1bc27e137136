// From matches to a camera pose: the methods of Panek, Sattler and Kukelova, "Combining Absolute
// and Semi-Generalized Relative Poses for Visual Localization" (2024), and more (options.h), behind
// one interface.

#pragma once

#include <memory>

#include "raylift/estimation/pose_estimate.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct EstimatorOptions;

// Thread safe: Estimate() keeps no state between calls.
class PoseEstimator {
 public:
  virtual ~PoseEstimator() = default;
  virtual PoseEstimate Estimate(const PoseProblem& problem) const = 0;
};

// Throws OptionError where the options are out of range. Matches that are not finite, or whose
// pixel has no ray, count as outliers.
std::unique_ptr<PoseEstimator> MakePoseEstimator(const EstimatorOptions& options);

}  // namespace raylift
