// How likely each piece of evidence of the joint refinement is right, and how noisy its kind is.

#pragma once

#include <optional>

#include "estimation/joint_model.h"
#include "estimation/student_t.h"
#include <Eigen/Core>

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

// The squared error along the axis that is best predicted, over its variance. The covariance has a
// positive determinant, however little is known along its other axis.
double SquaredAcross(const Eigen::Vector2d& error, const Eigen::Matrix2d& covariance);

// Sets the model's weights by what all other evidence predicts (they go `share` of the way from what
// they were, so that what contradicts each other comes to rest), and its noise by what the residuals
// show; the points must be the likeliest ones for the model as it is. `query_covariance`: of the
// query's unknowns. A pose that little is known of goes where any wrong match on an epipolar line
// calls it; what the match says of itself is no evidence for it.
void Reweigh(const NoisePrior& prior, double share, const Matrix7d& query_covariance,
             JointModel& model);

}  // namespace raylift
