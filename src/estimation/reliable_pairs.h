// Which 2D-2D matches near a pose can be trusted to refine it.
//
// A wrong match lands near its epipolar line by chance, and then mostly as a point close to the
// cameras, where random rays meet. Nothing in its residual tells it from a right one, but so near a
// point pulls at the position many times as hard as the true ones do: a handful of them spoils what
// hundreds of inliers know. How many of the matches at one parallax are there by chance shows in
// the residuals a little farther off, where only wrong ones are.

#pragma once

#include <vector>

#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"

namespace raylift {

// The indices, in order, of the pairs whose squared residual is below `limit`, without those at
// parallaxes where chance explains too many of them. `variance` is that of the residuals of right
// matches; all in units of the squared threshold.
std::vector<int> ReliablePairs(const PreparedProblem& problem, const SolverPose& pose,
                               const std::vector<double>& squared_residuals, double variance,
                               double limit);

}  // namespace raylift
