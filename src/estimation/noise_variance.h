// The noise of the residuals near a pose, estimated from themselves, and the robust loss for it.
// All in units of the squared threshold.

#pragma once

#include <vector>

#include "estimation/kernels/blocks.h"

namespace raylift {

// What is assumed of the noise's variance before anything is seen, as if a few matches had shown
// it.
inline constexpr double kPriorVariance = 0.1;

// What the noise of one kind of residual is estimated with: the mean square of a residual of unit
// variance that is cut at a limit, and where the robust loss ends for unit variance.
struct NoiseModel {
  double (*mean_square_below)(double squared_limit);
  double squared_loss_limit;  // 95 % of the efficiency of least squares on normal residuals
};
extern const NoiseModel kPointNoise;  // of two residuals per match
extern const NoiseModel kPairNoise;   // of one

// The variance of one residual component: the one that explains the mean square of the residuals
// within two and a half standard deviations. Where the residuals spread evenly over all that lies
// near, as with inaccurate geometry, it grows beyond bounds.
double NoiseVariance(const std::vector<double>& squared_residuals, const NoiseModel& model);

kernels::KernelLoss RobustLoss(double variance, const NoiseModel& model);

}  // namespace raylift
