// Linear least squares over a chain: unknown steps of 6 numbers, of which neighbors are tied to
// each other, and one more number that all may depend on (the border). Exact in linear time.

#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include <Eigen/Core>

namespace raylift {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

// H x = -g.
struct ChainEquations {
  explicit ChainEquations(size_t size)
      : diagonal(size, Matrix6::Zero()),
        below(size, Matrix6::Zero()),
        gradient(size, Vector6::Zero()),
        border(size, Vector6::Zero()) {}

  std::vector<Matrix6> diagonal;  // H_ii
  std::vector<Matrix6> below;     // H_i,i-1; nothing at 0
  std::vector<Vector6> gradient;
  std::vector<Vector6> border;  // H between step i and the number
  double corner = 0;
  double corner_gradient = 0;

  // Adds a term 1/2 r' W r with r = error + J step_i.
  void Add(size_t i, const Vector6& error, const Matrix6& jacobian, const Matrix6& weight);
  // The same with r = error + J step_i + K step_i-1 + k number.
  struct Jacobians {
    Matrix6 of_frame, of_before;
    Vector6 of_number;
  };
  void AddStep(size_t i, const Vector6& error, const Jacobians& jacobians, const Matrix6& weight);
};

struct ChainSolution {
  std::vector<Vector6> steps;
  double number = 0;
};

// nullopt where H, with its diagonal raised by the share `damping`, is not positive definite.
std::optional<ChainSolution> Solve(const ChainEquations& equations, double damping);

// Blocks of the inverse of H.
struct ChainCovariance {
  std::vector<Matrix6> diagonal;  // of step i
  std::vector<Matrix6> below;     // of step i with step i-1; nothing at 0
  double corner = 0;              // of the number
};
std::optional<ChainCovariance> Invert(const ChainEquations& equations);

}  // namespace raylift
