// Local optimization of poses inside RANSAC (the LO of LO-RANSAC).

#pragma once

#include "estimation/problem/normalized_problem.h"

#include "raylift/estimation/options.h"

namespace raylift {

// The share of the matches that takes part in a local optimization.
enum class OptimizedMatches {
  kEnough,  // a random part of each set, which stands for all of it
  kAll,
};

// The choice of the samples whose poses are optimized.
struct OptimizationPolicy {
  // The first iteration after which poses are optimized: earlier samples are soon beaten by others.
  int first_iteration;
  // The number of samples that are optimized although they come near the best one without beating
  // it.
  int max_near_best;
  OptimizedMatches matches;
};
// Returns the policy; the paper's is to optimize each new best pose at once, on all matches.
constexpr OptimizationPolicy PolicyOf(Refinement refinement) {
  return refinement == Refinement::kPaper ? OptimizationPolicy{1, 0, OptimizedMatches::kAll}
                                          : OptimizationPolicy{10, 6, OptimizedMatches::kEnough};
}

inline constexpr int kLocalSteps = 6;

// Takes a few steps on the MSAC cost (the sum of both sets' normalized truncated residuals, as in
// scoring) of the matches near the pose, in single precision.
CamFromLocal OptimizeLocally(const NormalizedProblem& problem, const CamFromLocal& pose,
                             MatchSets sets, int max_steps,
                             OptimizedMatches matches = OptimizedMatches::kEnough);

}  // namespace raylift
