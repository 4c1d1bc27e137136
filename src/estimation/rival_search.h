// A pose for what the best pose leaves unexplained: where that is one, too, the scene holds
// something twice, or one of the two is wrong as a whole.

#pragma once

#include <optional>
#include <vector>

#include "estimation/prepared_problem.h"

#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// Looks among the matches of the keypoints that are not explained, by samples of three 2D-3D matches
// where `points` are scored, of E5+1 otherwise: so many that a pose of a quarter of these matches, or
// of half of those, is found in nineteen cases of twenty.
std::optional<Rigid3> FindRival(const PoseProblem& problem, const PreparedProblem& prepared,
                                const std::vector<bool>& explained, bool points,
                                const EstimatorOptions& options);

}  // namespace raylift
