// How likely each piece of evidence of the joint refinement is right, and how noisy its kind is.

#pragma once

#include <optional>

#include "estimation/joint_model.h"
#include "estimation/student_t.h"

namespace raylift {

// A variance that is known before, as if `count` errors had shown it.
struct VariancePrior {
  double variance = 0;
  double count = 0;
};

// What is known of the noise before the query's own evidence.
struct NoisePrior {
  VariancePrior keypoint_px2, depth, common_depth;
  std::optional<TailPrior> keypoint_tail;
};

// Sets the model's weights by what all other evidence of the keypoint predicts (they go `share` of
// the way from what they were, so that what contradicts each other comes to rest), and its noise by
// what the residuals show; the points must be the likeliest ones for the model as it is.
void Reweigh(const NoisePrior& prior, double share, JointModel& model);

}  // namespace raylift
