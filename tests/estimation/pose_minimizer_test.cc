#include "estimation/refinement/pose_minimizer.h"

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
  Blocks2D3D<double> points;
  Blocks2D2D<double> pairs;

  explicit AllMatches(const NormalizedProblem& problem)
      : points(MakeBlocks2D3D<double>(problem.matches_2d3d, Indices(problem.matches_2d3d.size()))),
        pairs(MakeBlocks2D2D<double>(problem.matches_2d2d, Indices(problem.matches_2d2d.size()))) {}
  ActiveMatches<double> Active() const {
    return {points.blocks, points.block_camera, pairs.blocks, pairs.block_camera_reference};
  }

 private:
  static std::vector<int> Indices(size_t count) {
    std::vector<int> indices(count);
    std::iota(indices.begin(), indices.end(), 0);
    return indices;
  }
};

// The shapes and weights that refinements use.
const MatchSetWeights kEveryWeights[] = {
    {},
    {.loss_2d3d = {LossShape::kTruncated, 9}, .loss_2d2d = {LossShape::kTruncated, 9}},
    {.weight_2d3d = 4,
     .weight_2d2d = 0.5,
     .loss_2d3d = {LossShape::kBiweight, 7.5},
     .loss_2d2d = {LossShape::kBiweight, 5}}};

TEST(PoseMinimizer, GradientIsHalfOfTheCostsSlope) {
  Rng rng = TestRng();
  constexpr double kStep = 1e-7;
  for (const MatchSetWeights& weights : kEveryWeights) {
    const NearTruth near = MakeNearTruth(rng, {});
    const AllMatches matches(near.prepared);
    const auto at = [&](const CamFromLocal& pose) {
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
  points.blocks_2d2d = {};
  ActiveMatches<double> pairs = matches.Active();
  pairs.blocks_2d3d = {};
  const auto linearize = [&](const ActiveMatches<double>& active, const MatchSetWeights& weights) {
    return Linearize(near.prepared, active, near.local, weights);
  };
  const NormalEquations of_2d3d = linearize(points, {});
  const NormalEquations of_2d2d = linearize(pairs, {});
  const NormalEquations both = linearize(matches.Active(), {.weight_2d3d = 4, .weight_2d2d = 0.5});
  EXPECT_EQ(both.cost, 4 * of_2d3d.cost + 0.5 * of_2d2d.cost);
  EXPECT_EQ(both.gradient, 4 * of_2d3d.gradient + 0.5 * of_2d2d.gradient);
  EXPECT_EQ(both.hessian, 4 * of_2d3d.hessian + 0.5 * of_2d2d.hessian);
}

TEST(PoseMinimizer, MoreStepsNeverCostMore) {
  Rng rng = TestRng();
  for (const double turn_deg : {0.1, 1.0, 5.0}) {
    for (const MatchSetWeights& weights : kEveryWeights) {
      const NearTruth near = MakeNearTruth(rng, {}, turn_deg, 0.1 * turn_deg);
      const AllMatches matches(near.prepared);
      const auto cost = [&](const CamFromLocal& pose) {
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
  for (const MatchSetWeights& weights : kEveryWeights) {
    const NearTruth near = MakeNearTruth(rng, {});
    const AllMatches matches(near.prepared);
    const CamFromLocal pose =
        Minimize(near.prepared, matches.Active(), near.local, weights, 100, 0);
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
  const CamFromLocal pose =
      Minimize(near.prepared, ActiveMatches<double>{}, near.local, MatchSetWeights{}, 10, 1e-9);
  EXPECT_LT((pose.rotation - near.local.rotation).norm(), 1e-15);
  EXPECT_EQ(pose.translation, near.local.translation);
}

}  // namespace
}  // namespace raylift
