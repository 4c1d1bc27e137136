// What the tests of whole estimators share.

#pragma once

#include <vector>

#include <gtest/gtest.h>

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// The settings of the standard regimes: 4 px and 2 px, 100 to 10000 iterations, 0.9999.
EstimatorOptions StandardOptions(Method method);

PoseEstimate EstimateWith(const EstimatorOptions& options, const PoseProblem& problem);
PoseEstimate EstimateWith(Method method, const PoseProblem& problem);

// Returns how far the camera's center is from the true one. Where there is no pose, the first throws,
// and for the second it is 1000 away.
double PositionError(const PoseEstimate& estimate, const Rigid3& truth);
double PositionErrorOrFar(const PoseEstimate& estimate, const Rigid3& truth);

// But D3+1, which needs points lifted from pairs (d3p1_test.cc).
inline constexpr Method kEveryMethod[] = {Method::kP3p,    Method::kE5p1,         Method::kAdaptive,
                                          Method::kSelect, Method::kHybridRansac, Method::kHloc};

// No NaN anywhere, sizes that fit the problem, and either a pose or a reason.
::testing::AssertionResult IsSound(const PoseEstimate& estimate, const PoseProblem& problem);

// Every number and flag of two estimates is the same.
::testing::AssertionResult IsIdentical(const PoseEstimate& a, const PoseEstimate& b);

}  // namespace raylift
