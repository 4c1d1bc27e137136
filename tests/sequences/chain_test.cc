#include "sequences/chain.h"

#include "base/rng.h"
#include "support/matchers.h"
#include <Eigen/Dense>
#include <gtest/gtest.h>

namespace raylift {
namespace {

using Eigen::Index;

Eigen::MatrixXd Random(Rng& rng, Index rows, Index columns) {
  Eigen::MatrixXd matrix(rows, columns);
  for (double& x : matrix.reshaped()) x = rng.Normal();
  return matrix;
}

// The same terms as a chain and as one dense matrix.
struct BothForms {
  ChainEquations chain{5};
  Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(31, 31);
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(31);
};

BothForms MakeBoth(Rng& rng) {
  BothForms both;
  for (size_t i = 0; i < 5; ++i) {
    const Matrix6d root = Random(rng, 6, 6);
    const Matrix6d weight = root * root.transpose() + Matrix6d::Identity();
    const Vector6d error = Random(rng, 6, 1);
    Eigen::MatrixXd all = Eigen::MatrixXd::Zero(6, 31);
    if (i == 0) {
      const Matrix6d jacobian = Matrix6d::Identity() + 0.2 * Random(rng, 6, 6);
      both.chain.Add(0, error, jacobian, weight);
      all.leftCols<6>() = jacobian;
    } else {
      const ChainEquations::Jacobians J{Matrix6d::Identity() + 0.2 * Random(rng, 6, 6),
                                        0.5 * Random(rng, 6, 6), Random(rng, 6, 1)};
      both.chain.AddStep(i, error, J, weight);
      const auto column = static_cast<Index>(6 * i);
      all.middleCols<6>(column) = J.of_frame;
      all.middleCols<6>(column - 6) = J.of_before;
      all.col(30) = J.of_number;
    }
    both.hessian += all.transpose() * weight * all;
    both.gradient += all.transpose() * weight * error;
  }
  both.chain.corner += 1;
  both.hessian(30, 30) += 1;
  return both;
}

TEST(Chain, SolvesAsTheDenseMatrixDoes) {
  Rng rng = TestRng();
  const BothForms both = MakeBoth(rng);
  const auto solution = Solve(both.chain, 0);
  ASSERT_TRUE(solution);
  const Eigen::VectorXd expected = -both.hessian.ldlt().solve(both.gradient);
  for (Index i = 0; i < 5; ++i) {
    EXPECT_LT((solution->steps[static_cast<size_t>(i)] - expected.segment<6>(6 * i)).norm(),
              1e-8 * expected.norm());
  }
  EXPECT_NEAR(solution->number, expected[30], 1e-8 * expected.norm());
}

TEST(Chain, CovariancesAreBlocksOfTheInverse) {
  Rng rng = TestRng();
  const BothForms both = MakeBoth(rng);
  const auto covariance = Invert(both.chain);
  ASSERT_TRUE(covariance);
  const Eigen::MatrixXd expected = both.hessian.inverse();
  const double tolerance = 1e-8 * expected.norm();
  for (Index i = 0; i < 5; ++i) {
    const auto k = static_cast<size_t>(i);
    EXPECT_LT((covariance->diagonal[k] - expected.block<6, 6>(6 * i, 6 * i)).norm(), tolerance);
    if (i == 0) continue;
    EXPECT_LT((covariance->below[k] - expected.block<6, 6>(6 * i, 6 * i - 6)).norm(), tolerance);
  }
  EXPECT_NEAR(covariance->corner, expected(30, 30), tolerance);
}

TEST(Chain, WhatNothingDeterminesHasNoSolution) {
  ChainEquations equations(2);
  equations.corner = 1;
  equations.Add(0, Vector6d::Ones(), Matrix6d::Identity(), Matrix6d::Identity());
  EXPECT_FALSE(Solve(equations, 0));
  EXPECT_FALSE(Invert(equations));
}

}  // namespace
}  // namespace raylift
