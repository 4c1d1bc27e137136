// The one LO-RANSAC loop: P3P, E5+1 and the variants of Adaptive are configurations of it.

#pragma once

#include <optional>
#include <vector>

#include "estimation/hypothesis_generators.h"
#include "estimation/joint_score.h"
#include "estimation/prepared_problem.h"
#include "estimation/refinement.h"

#include "raylift/base/rng.h"
#include "raylift/estimation/pose_estimator.h"

namespace raylift {

// A way to make hypotheses, and what refines a new best pose that it made.
struct RansacSolver {
  const HypothesisGenerator* generator;
  Solver solver;
  ResidualKinds refined_kinds;
};

struct RansacResult {
  SolverPose pose;
  Solver solver;
  ResidualKinds refined_kinds;
};

struct RansacReport {
  std::optional<RansacResult> best;
  int iterations = 0;
};

// In every iteration each solver draws one sample and all poses are scored; a new best is locally
// optimized. Ends when, for one of the solvers, a sample of inliers alone has been drawn with the
// wanted confidence (inliers of the jointly best pose), within the limits of the options.
RansacReport RunRansac(const PreparedProblem& problem, const Objective& objective,
                       const std::vector<RansacSolver>& solvers, const EstimatorOptions& options,
                       Rng& rng);

}  // namespace raylift
