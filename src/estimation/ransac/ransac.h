// The one LO-RANSAC loop: P3P, E5+1 and the variants of Adaptive are configurations of it.

#pragma once

#include <optional>
#include <vector>

#include "base/rng.h"
#include "estimation/problem/normalized_problem.h"
#include "estimation/ransac/local_optimization.h"
#include "estimation/ransac/samplers.h"
#include "estimation/ransac/scores.h"

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"

namespace raylift {

// A way to make hypotheses, and the matches that optimize a new best one locally.
struct RansacSolver {
  const HypothesisSampler* sampler;
  Solver solver;
  MatchSets optimized_sets;
};

// The solvers that draw a sample in an iteration.
enum class SolverSchedule {
  kAll,            // each of them (Adaptive)
  kByProbability,  // one, drawn by how likely it is to succeed now (Camposeco et al. 2018, Eq. 1)
};

struct RansacResult {
  CamFromLocal pose;
  Solver solver;
  MatchSets optimized_sets;
};

// Returns whether poses are different answers: more than .01 radians apart in rotation, or .1 local
// units in center.
bool AreApart(const CamFromLocal& a, const CamFromLocal& b);

struct RansacReport {
  std::optional<RansacResult> best;
  double best_value = 0;  // PoseScore::Value()
  // These locally optimized poses are elsewhere, and explain at least half as much as the best one.
  std::vector<CamFromLocal> alternatives;
  // These are the locally optimized poses of E5+1 and of D3+1 that score best on the 2D-2D matches
  // alone, if they were asked for (RansacOptions::keeps_best_of_2d2d), are apart from the best one
  // and leave it in doubt.
  std::vector<RansacResult> best_of_2d2d;
  int iterations = 0;
};

// RANSAC's stopping criterion and its policy of local optimization.
struct RansacOptions {
  int min_iterations, max_iterations;
  double confidence;
  OptimizationPolicy optimization;
  bool keeps_best_of_2d2d = false;  // RansacReport::best_of_2d2d

  RansacOptions(const EstimatorOptions& options)  // NOLINT: its part of them
      : min_iterations(options.min_iterations),
        max_iterations(options.max_iterations),
        confidence(options.confidence),
        optimization(PolicyOf(options.refinement)) {}
};

// Runs LO-RANSAC. In every iteration the scheduled solvers draw one sample each and all poses are
// scored; a new best is locally optimized. Ends when one of the solvers has drawn so many samples
// that, with the wanted confidence, one of them was of inliers alone (inliers of the jointly best
// pose), within the limits of the options.
RansacReport RunRansac(const NormalizedProblem& problem, const PoseScore& pose_score,
                       const std::vector<RansacSolver>& solvers, SolverSchedule schedule,
                       const RansacOptions& options, Rng& rng);

}  // namespace raylift
