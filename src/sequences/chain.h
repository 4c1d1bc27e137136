// Linear least squares over a chain: unknown steps of 6 numbers, of which neighbors are tied to
// each other, and one more number that all may depend on (the border). Exact in linear time.

#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "geometry/pose_step.h"
#include <Eigen/Core>

namespace raylift {

// The equations H x = -g.
struct ChainEquations {
  explicit ChainEquations(size_t size)
      : diagonal(size, Matrix6d::Zero()),
        below(size, Matrix6d::Zero()),
        gradient(size, Vector6d::Zero()),
        border(size, Vector6d::Zero()) {}

  std::vector<Matrix6d> diagonal;  // H_ii
  std::vector<Matrix6d> below;     // H_i,i-1; nothing at 0
  std::vector<Vector6d> gradient;
  std::vector<Vector6d> border;  // H between step i and the number
  double corner = 0;
  double corner_gradient = 0;

  // Adds a term 1/2 r' W r with r = error + J step_i.
  void Add(size_t i, const Vector6d& error, const Matrix6d& jacobian, const Matrix6d& weight);
  // These are the derivatives J, K and k of a term 1/2 r' W r with r = error + J step_i + K
  // step_i-1 + k number, which AddStep() adds.
  struct Jacobians {
    Matrix6d of_frame, of_before;
    Vector6d of_number;
  };
  void AddStep(size_t i, const Vector6d& error, const Jacobians& jacobians, const Matrix6d& weight);
};

struct ChainSolution {
  std::vector<Vector6d> steps;
  double number = 0;
};

// Solves the equations; nullopt where H, with its diagonal raised by the share `damping`, is not
// positive definite.
std::optional<ChainSolution> Solve(const ChainEquations& equations, double damping);

// Blocks of the inverse of H, the covariance.
struct ChainCovariance {
  std::vector<Matrix6d> diagonal;  // of step i
  std::vector<Matrix6d> below;     // of step i with step i-1; nothing at 0
  double corner = 0;               // of the number
};
std::optional<ChainCovariance> Invert(const ChainEquations& equations);

}  // namespace raylift
