// The squared residuals of all matches of a prepared problem, in units of the squared thresholds.

#pragma once

#include <vector>

#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"

namespace raylift {

// Which residuals take part.
struct ResidualKinds {
  bool points = true;
  bool pairs = true;
};

// Squared residuals below this are near enough to a pose for their matches to become inliers in a
// few steps: three thresholds.
inline constexpr double kNearSquared = 9;

// The squared normalized residual of every prepared match of some kinds (of the others none), in
// double precision; infinite where a match lies behind a camera.
struct Residuals {
  std::vector<double> points;
  std::vector<double> pairs;
};
Residuals ComputeResiduals(const PreparedProblem& problem, const SolverPose& pose,
                           ResidualKinds kinds = {});

}  // namespace raylift
