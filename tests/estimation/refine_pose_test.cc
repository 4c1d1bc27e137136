#include <limits>

#include "base/rng.h"
#include "estimation/standard_options.h"
#include "support/matchers.h"
#include "support/synthetic_problem.h"

#include "raylift/base/error.h"
#include "raylift/estimation/options.h"
#include "raylift/estimation/solvers.h"

namespace raylift {
namespace {

Rigid3 Displaced(const Rigid3& pose, double deg, double units) {
  const Eigen::Vector3d axis = Eigen::Vector3d(1, -2, 0.5).normalized();
  return Rigid3{RotationFromVector(deg * 0.0174533 * axis), units * axis} * pose;
}

TEST(RefinePose, ReachesTheTruthFromNearItByEveryMethod) {
  Rng rng = TestRng();
  for (const Refinement refinement : {Refinement::kRobust, Refinement::kPaper}) {
    for (const Method method : kEveryMethod) {
      const SyntheticProblem made = MakeSyntheticProblem("refine", {}, rng);
      EstimatorOptions options = StandardOptions(method);
      options.refinement = refinement;
      const PoseEstimate estimate =
          RefinePose(made.problem, options, Displaced(made.query_from_world, 0.3, 0.03));
      EXPECT_TRUE(IsSound(estimate, made.problem));
      ASSERT_TRUE(estimate.cam_from_world) << ToString(method);
      // As near as RANSAC comes with a pixel's noise.
      EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, made.query_from_world, 0.2, 0.05));
      EXPECT_EQ(estimate.verdict, PoseVerdict::kLocalized);
      EXPECT_EQ(estimate.iterations, 0);
    }
  }
}

TEST(RefinePose, TakesWhichSetThereIs) {
  Rng rng = TestRng();
  SyntheticOptions pairs_alone;
  pairs_alone.num_2d3d = 0;
  const SyntheticProblem made = MakeSyntheticProblem("refine", pairs_alone, rng);
  const PoseEstimate estimate = RefinePose(made.problem, StandardOptions(Method::kAdaptive),
                                           Displaced(made.query_from_world, 0.3, 0.03));
  ASSERT_TRUE(estimate.cam_from_world);
  EXPECT_EQ(estimate.solver, Solver::kE5p1);
  EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, made.query_from_world, 0.2, 0.05));
}

TEST(RefinePose, FindsNothingFarFromTheTruth) {
  Rng rng = TestRng();
  const SyntheticProblem made = MakeSyntheticProblem("refine", {}, rng);
  for (const Method method : kEveryMethod) {
    const EstimatorOptions options = StandardOptions(method);
    EXPECT_FALSE(
        RefinePose(made.problem, options, Displaced(made.query_from_world, 120, 3)).cam_from_world);
    Rigid3 infinite = made.query_from_world;
    infinite.translation.x() = std::numeric_limits<double>::infinity();
    EXPECT_FALSE(RefinePose(made.problem, options, infinite).cam_from_world);
  }
  EXPECT_THROW(RefinePose(made.problem, {.alpha = -1}, made.query_from_world), OptionError);
}

}  // namespace
}  // namespace raylift
