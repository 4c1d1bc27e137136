// Local optimization inside RANSAC (the LO of LO-RANSAC).

#pragma once

#include "estimation/match_residuals.h"
#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"

namespace raylift {

// How many matches take part.
enum class OptimizedMatches {
  kEnough,  // a random part of each kind, which stands for all of it
  kAll,
};

// A few steps on the MSAC cost (the sum of both kinds' normalized truncated residuals, as in
// scoring) of the matches near the pose, in single precision.
SolverPose OptimizeLocally(const PreparedProblem& problem, const SolverPose& pose,
                           ResidualKinds kinds, int max_steps,
                           OptimizedMatches matches = OptimizedMatches::kEnough);

}  // namespace raylift
