// Minimizing a robust cost of matches over the pose, by Levenberg-Marquardt on fixed-size normal
// equations that the kernels sum: in single precision for local optimization, in double for the
// final refinement.

#pragma once

#include <span>

#include "estimation/kernels/blocks.h"
#include "estimation/normal_equations.h"
#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"

namespace raylift {

// The matches that a refinement works on; blocks that live elsewhere.
template <typename T>
struct ActiveMatches {
  std::span<const kernels::PointBlock<T>> point_blocks;
  std::span<const int> point_block_camera;
  std::span<const kernels::PairBlock<T>> pair_blocks;
  std::span<const int> pair_block_view;
};

// What a match costs: its kind's weight times the loss of its squared residual; and the weight of
// the pose's priors, whose residuals are over standard deviations instead of thresholds.
struct KindWeights {
  double point_weight = 1;
  double pair_weight = 1;
  double prior_weight = kSquaredSigma;
  kernels::KernelLoss point_loss = {};
  kernels::KernelLoss pair_loss = {};
};

template <typename T>
NormalEquations Linearize(const PreparedProblem& problem, const ActiveMatches<T>& matches,
                          const SolverPose& pose, const KindWeights& weights);

SolverPose Moved(const SolverPose& pose, const Vector6d& step);

// Takes `max_steps` steps at most, of which none raises the cost; ends sooner where a step gains
// less than `relative_tolerance` of the cost.
template <typename T>
SolverPose Minimize(const PreparedProblem& problem, const ActiveMatches<T>& matches,
                    const SolverPose& start, const KindWeights& weights, int max_steps,
                    double relative_tolerance);

}  // namespace raylift
