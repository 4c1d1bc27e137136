// The one LO-RANSAC loop: P3P, E5+1 and the variants of Adaptive are configurations of it.

#pragma once

#include <optional>
#include <vector>

#include "base/rng.h"
#include "estimation/hypothesis_generators.h"
#include "estimation/joint_score.h"
#include "estimation/match_residuals.h"
#include "estimation/prepared_problem.h"

#include "raylift/estimation/pose_estimator.h"

namespace raylift {

// A way to make hypotheses, and what refines a new best pose that it made.
struct RansacSolver {
  const HypothesisGenerator* generator;
  Solver solver;
  ResidualKinds refined_kinds;
};

// Which solvers draw a sample in an iteration.
enum class SolverSchedule {
  kAll,            // each of them (Adaptive)
  kByProbability,  // one, drawn by how likely it is to succeed now (Camposeco et al. 2018, Eq. 1)
};

struct RansacResult {
  SolverPose pose;
  Solver solver;
  ResidualKinds refined_kinds;
};

struct RansacReport {
  std::optional<RansacResult> best;
  double best_value = 0;  // Objective::Value()
  // Optimized poses elsewhere that explain at least half as much as the best one.
  std::vector<SolverPose> rivals;
  int iterations = 0;
};

// In every iteration the scheduled solvers draw one sample each and all poses are scored; a new
// best is locally optimized. Ends when one of the solvers has drawn so many samples that, with the
// wanted confidence, one of them was of inliers alone (inliers of the jointly best pose), within
// the limits of the options.
RansacReport RunRansac(const PreparedProblem& problem, const Objective& objective,
                       const std::vector<RansacSolver>& solvers, SolverSchedule schedule,
                       const EstimatorOptions& options, Rng& rng);

}  // namespace raylift
