// A pose for what the best pose leaves unexplained: where that is one, too, the scene holds
// something twice, or one of the two is wrong as a whole.

#pragma once

#include <optional>
#include <vector>

#include "estimation/match_residuals.h"
#include "estimation/prepared_problem.h"

#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// So many that one is of right matches alone in nineteen cases of twenty, where one in 64 is: three
// of a quarter, six of a half.
inline constexpr int kRivalSamples = 191;

// Looks among the matches of the keypoints that are not explained, by samples of three 2D-3D matches
// where these are of the scored kinds and left, of E5+1 otherwise.
std::optional<Rigid3> FindRival(const PoseProblem& problem, const PreparedProblem& prepared,
                                const std::vector<bool>& explained, ResidualKinds scored,
                                const EstimatorOptions& options);

}  // namespace raylift
