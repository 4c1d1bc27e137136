#include "estimation/pose_minimizer.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "estimation/near_truth.h"
#include <Eigen/Cholesky>
#include <Eigen/LU>

namespace raylift {
namespace {

using kernels::LossShape;

// All matches of a problem, in double precision.
struct AllMatches {
  PointBlocks<double> points;
  PairBlocks<double> pairs;

  explicit AllMatches(const PreparedProblem& problem)
      : points(MakePointBlocks<double>(problem.points, Indices(problem.points.size()))),
        pairs(MakePairBlocks<double>(problem.pairs, Indices(problem.pairs.size()))) {}
  ActiveMatches<double> Active() const {
    return {points.blocks, points.block_camera, pairs.blocks, pairs.block_view};
  }

 private:
  static std::vector<int> Indices(size_t count) {
    std::vector<int> indices(count);
    std::iota(indices.begin(), indices.end(), 0);
    return indices;
  }
};

// The shapes and weights that refinements use.
const KindWeights kEveryWeights[] = {
    {},
    {.point_loss = {LossShape::kTruncated, 9}, .pair_loss = {LossShape::kTruncated, 9}},
    {.point_weight = 4,
     .pair_weight = 0.5,
     .point_loss = {LossShape::kBiweight, 7.5},
     .pair_loss = {LossShape::kBiweight, 5}}};

TEST(PoseMinimizer, GradientIsHalfOfTheCostsSlope) {
  Rng rng = TestRng();
  constexpr double kStep = 1e-7;
  for (const KindWeights& weights : kEveryWeights) {
    const NearTruth near = MakeNearTruth(rng, {});
    const AllMatches matches(near.prepared);
    const auto at = [&](const SolverPose& pose) {
      return Linearize(near.prepared, matches.Active(), pose, weights);
    };
    const NormalEquations equations = at(near.local);
    for (int i = 0; i < 6; ++i) {
      const Vector6d step = kStep * Vector6d::Unit(i);
      const double slope =
          (at(Moved(near.local, step)).cost - at(Moved(near.local, -step)).cost) / (2 * kStep);
      const double scale = std::sqrt(equations.hessian(i, i) * equations.cost);
      EXPECT_NEAR(equations.gradient[i], 0.5 * slope, 1e-4 * scale) << i;
    }
  }
}

TEST(PoseMinimizer, WeighsEachKindByItself) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  const AllMatches matches(near.prepared);
  ActiveMatches<double> points = matches.Active();
  points.pair_blocks = {};
  ActiveMatches<double> pairs = matches.Active();
  pairs.point_blocks = {};
  const auto linearize = [&](const ActiveMatches<double>& active, const KindWeights& weights) {
    return Linearize(near.prepared, active, near.local, weights);
  };
  const NormalEquations of_points = linearize(points, {});
  const NormalEquations of_pairs = linearize(pairs, {});
  const NormalEquations both = linearize(matches.Active(), {.point_weight = 4, .pair_weight = 0.5});
  EXPECT_EQ(both.cost, 4 * of_points.cost + 0.5 * of_pairs.cost);
  EXPECT_EQ(both.gradient, 4 * of_points.gradient + 0.5 * of_pairs.gradient);
  EXPECT_EQ(both.hessian, 4 * of_points.hessian + 0.5 * of_pairs.hessian);
}

TEST(PoseMinimizer, MoreStepsNeverCostMore) {
  Rng rng = TestRng();
  for (const double turn_deg : {0.1, 1.0, 5.0}) {
    for (const KindWeights& weights : kEveryWeights) {
      const NearTruth near = MakeNearTruth(rng, {}, turn_deg, 0.1 * turn_deg);
      const AllMatches matches(near.prepared);
      const auto cost = [&](const SolverPose& pose) {
        return Linearize(near.prepared, matches.Active(), pose, weights).cost;
      };
      double least = cost(near.local);
      for (int steps = 0; steps < 15; ++steps) {
        const double reached =
            cost(Minimize(near.prepared, matches.Active(), near.local, weights, steps, 0));
        EXPECT_LE(reached, (1 + 1e-9) * least) << steps;  // the rotation is rounded at the end
        least = std::min(least, reached);
      }
    }
  }
}

TEST(PoseMinimizer, EndsWhereNoStepIsLeft) {
  Rng rng = TestRng();
  for (const KindWeights& weights : kEveryWeights) {
    const NearTruth near = MakeNearTruth(rng, {});
    const AllMatches matches(near.prepared);
    const SolverPose pose = Minimize(near.prepared, matches.Active(), near.local, weights, 100, 0);
    const NormalEquations equations = Linearize(near.prepared, matches.Active(), pose, weights);
    const Vector6d step = equations.hessian.ldlt().solve(equations.gradient);
    EXPECT_LT(step.norm(), 1e-7);
    EXPECT_LT((pose.rotation.transpose() * pose.rotation - Eigen::Matrix3d::Identity()).norm(),
              1e-14);
    EXPECT_NEAR(pose.rotation.determinant(), 1, 1e-14);
  }
}

TEST(PoseMinimizer, StaysWhereThereAreNoMatches) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  const SolverPose pose =
      Minimize(near.prepared, ActiveMatches<double>{}, near.local, KindWeights{}, 10, 1e-9);
  EXPECT_LT((pose.rotation - near.local.rotation).norm(), 1e-15);
  EXPECT_EQ(pose.translation, near.local.translation);
}

}  // namespace
}  // namespace raylift
