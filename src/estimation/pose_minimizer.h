// Minimizing a robust cost of matches over the pose, by Levenberg-Marquardt on fixed-size normal
// equations that the kernels sum: in single precision for local optimization, in double for the
// final refinement.
//
// Poses change on the left, in the camera's tangent frame, as in geometry/residuals.h: a step
// (w, v) turns [R t] into [exp(w) R, exp(w) t + v], v in local units.

#pragma once

#include <span>

#include "estimation/kernels/blocks.h"
#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"
#include <Eigen/Core>

namespace raylift {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

// The matches that a refinement works on; blocks that live elsewhere.
template <typename T>
struct ActiveMatches {
  std::span<const kernels::PointBlock<T>> point_blocks;
  std::span<const kernels::PairBlock<T>> pair_blocks;
  std::span<const int> pair_block_reference;
};

// What a match costs: its kind's weight times the loss of its squared residual.
struct KindWeights {
  double point_weight = 1;
  double pair_weight = 1;
  kernels::KernelLoss point_loss = {};
  kernels::KernelLoss pair_loss = {};
};

// The cost at a pose and, for a step from it, half of the cost's gradient and the Gauss-Newton
// matrix of the same scale.
struct NormalEquations {
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double cost = 0;
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
