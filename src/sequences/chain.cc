#include "sequences/chain.h"

#include <utility>

#include <Eigen/Cholesky>

namespace raylift {
namespace {

// Factors H without the border: L D L', with blocks of 6 x 6; the border is eliminated last.
class BlockCholesky {
 public:
  static std::optional<BlockCholesky> Of(const ChainEquations& equations, double damping) {
    BlockCholesky made;
    const size_t size = equations.diagonal.size();
    const auto damped = [&](const Matrix6d& block) {
      Matrix6d raised = block;
      raised.diagonal() *= 1 + damping;
      return raised;
    };
    for (size_t i = 0; i < size; ++i) {
      Matrix6d pivot = damped(equations.diagonal[i]);
      Matrix6d factor = Matrix6d::Zero();
      if (i > 0) {
        factor = made.pivots_[i - 1].solve(equations.below[i].transpose()).transpose();
        pivot -= factor * equations.below[i].transpose();
      }
      made.pivots_.emplace_back(pivot);
      made.factors_.push_back(factor);
      if (made.pivots_.back().info() != Eigen::Success) return std::nullopt;
    }
    made.of_border_ = made.Apply(equations.border);
    made.corner_ = equations.corner * (1 + damping);
    for (size_t i = 0; i < size; ++i) made.corner_ -= equations.border[i].dot(made.of_border_[i]);
    return made.corner_ > 0 ? std::optional(std::move(made)) : std::nullopt;
  }

  ChainSolution Solve(const ChainEquations& equations) const {
    ChainSolution solution{Apply(equations.gradient), -equations.corner_gradient};
    for (size_t i = 0; i < pivots_.size(); ++i) {
      solution.number += equations.border[i].dot(solution.steps[i]);
    }
    solution.number /= corner_;
    for (size_t i = 0; i < pivots_.size(); ++i) {
      solution.steps[i] = -solution.steps[i] - of_border_[i] * solution.number;
    }
    return solution;
  }

  ChainCovariance Covariance() const {
    const size_t size = pivots_.size();
    ChainCovariance covariance{std::vector<Matrix6d>(size), std::vector<Matrix6d>(size),
                               1 / corner_};
    for (size_t i = size; i-- > 0;) {
      covariance.diagonal[i] = pivots_[i].solve(Matrix6d::Identity());
      if (i + 1 == size) continue;
      const Matrix6d& next = covariance.diagonal[i + 1];
      covariance.below[i + 1] = -next * factors_[i + 1];
      covariance.diagonal[i] += factors_[i + 1].transpose() * next * factors_[i + 1];
    }
    for (size_t i = size; i-- > 0;) {
      covariance.diagonal[i] += of_border_[i] * of_border_[i].transpose() / corner_;
      if (i > 0) covariance.below[i] += of_border_[i] * of_border_[i - 1].transpose() / corner_;
    }
    return covariance;
  }

 private:
  // Returns the inverse of H without the border, times `right`.
  std::vector<Vector6d> Apply(const std::vector<Vector6d>& right) const {
    std::vector<Vector6d> x = right;
    for (size_t i = 1; i < x.size(); ++i) x[i] -= factors_[i] * x[i - 1];
    for (size_t i = x.size(); i-- > 0;) {
      x[i] = pivots_[i].solve(x[i]).eval();
      if (i + 1 < x.size()) x[i] -= factors_[i + 1].transpose() * x[i + 1];
    }
    return x;
  }

  std::vector<Eigen::LLT<Matrix6d>> pivots_;
  std::vector<Matrix6d> factors_;
  std::vector<Vector6d> of_border_;
  double corner_ = 1;
};

}  // namespace

void ChainEquations::Add(size_t i, const Vector6d& error, const Matrix6d& jacobian,
                         const Matrix6d& weight) {
  const Matrix6d weighted = jacobian.transpose() * weight;
  diagonal[i] += weighted * jacobian;
  gradient[i] += weighted * error;
}

void ChainEquations::AddStep(size_t i, const Vector6d& error, const Jacobians& jacobians,
                             const Matrix6d& weight) {
  Add(i, error, jacobians.of_frame, weight);
  Add(i - 1, error, jacobians.of_before, weight);
  const Vector6d weighted = weight * jacobians.of_number;
  below[i] += jacobians.of_frame.transpose() * weight * jacobians.of_before;
  border[i] += jacobians.of_frame.transpose() * weighted;
  border[i - 1] += jacobians.of_before.transpose() * weighted;
  corner += jacobians.of_number.dot(weighted);
  corner_gradient += error.dot(weighted);
}

std::optional<ChainSolution> Solve(const ChainEquations& equations, double damping) {
  const auto factored = BlockCholesky::Of(equations, damping);
  if (!factored) return std::nullopt;
  return factored->Solve(equations);
}

std::optional<ChainCovariance> Invert(const ChainEquations& equations) {
  const auto factored = BlockCholesky::Of(equations, 0);
  if (!factored) return std::nullopt;
  return factored->Covariance();
}

}  // namespace raylift
