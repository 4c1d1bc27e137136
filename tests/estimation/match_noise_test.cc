#include "raylift/estimation/match_noise.h"

#include <cmath>
#include <vector>

#include "support/coherent_problem.h"
#include "support/matchers.h"

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"

namespace raylift {
namespace {

MatchNoise Depth(double sigma, double errors) {
  MatchNoise noise;
  noise.depth = sigma;
  noise.depth_errors = errors;
  return noise;
}

TEST(PoolNoise, AddsWhatQueriesAgreeOn) {
  const std::vector<MatchNoise> alike(10, Depth(0.02, 50));
  const SceneNoise scene = PoolNoise(alike);
  EXPECT_NEAR(scene.depth.sigma, 0.02, 1e-9);
  EXPECT_NEAR(scene.depth.errors, 500, 1e-6);
  EXPECT_EQ(scene.common_depth, KnownNoise{});
}

TEST(PoolNoise, SaysLittleWhereQueriesDiffer) {
  std::vector<MatchNoise> mixed;
  for (const double sigma : {0.001, 0.004, 0.02, 0.1}) mixed.push_back(Depth(sigma, 200));
  const SceneNoise scene = PoolNoise(mixed);
  EXPECT_LT(scene.depth.errors, 3);
  EXPECT_GT(scene.depth.sigma, 0.001);
  EXPECT_LT(scene.depth.sigma, 0.1);
}

TEST(PoolNoise, LeavesOutGuesses) {
  const SceneNoise scene = PoolNoise(std::vector{Depth(0.02, 100), Depth(0.02, 80), Depth(0.02, 90),
                                                 Depth(1, 0), Depth(0.9, 0.5)});
  EXPECT_NEAR(scene.depth.sigma, 0.02, 1e-9);
  EXPECT_EQ(PoolNoise({}), SceneNoise{});
  // Of one query, or of few errors each, the spread is not known.
  EXPECT_EQ(PoolNoise(std::vector{Depth(0.02, 800), Depth(1, 0), Depth(1, 0)}), SceneNoise{});
  EXPECT_EQ(PoolNoise(std::vector(30, Depth(0.02, 4))), SceneNoise{});
}

TEST(PoolNoise, TakesTailsOfManyErrorsOnly) {
  const auto tail = [](double value, double errors) {
    MatchNoise noise;
    noise.keypoint_px = 0.5;
    noise.keypoint_tail = value;
    noise.keypoint_errors = errors;
    return noise;
  };
  const SceneNoise scene = PoolNoise(
      std::vector{tail(0.1, 300), tail(0.2, 300), tail(0.3, 300), tail(0.5, 4), tail(0.5, 0)});
  EXPECT_NEAR(scene.keypoint_tail, 0.2, 1e-9);
  EXPECT_NEAR(scene.keypoint_tail_variance, 0.01, 1e-9);
  EXPECT_EQ(PoolNoise(std::vector(5, tail(0.5, 4))).keypoint_tail_variance, 0);
}

// A query that sees few keypoints is as good as the better of its parts where the others know the
// noise of its depths.
TEST(SceneNoise, HelpsQueriesOfFewKeypoints) {
  Rng rng = TestRng();
  std::vector<MatchNoise> noise;
  for (int i = 0; i < 10; ++i) {
    const CoherentProblem made = MakeCoherentProblem("many", {.num_keypoints = 200}, rng);
    const PoseEstimate estimate = MakePoseEstimator({})->Estimate(made.problem);
    ASSERT_TRUE(estimate.noise);
    noise.push_back(*estimate.noise);
  }
  EstimatorOptions knowing;
  knowing.scene_noise = PoolNoise(noise);
  EXPECT_LT(knowing.scene_noise->depth.sigma, 0.003);
  double log_ratio = 0;
  constexpr int kProblems = 100;
  for (int i = 0; i < kProblems; ++i) {
    const CoherentProblem made =
        MakeCoherentProblem("few", {.num_keypoints = 25, .num_references = 3}, rng);
    const auto error = [&](const EstimatorOptions& options) {
      const PoseEstimate estimate = MakePoseEstimator(options)->Estimate(made.problem);
      if (!estimate.cam_from_world) return 100.0;
      return (estimate.cam_from_world->OriginInSource() - made.query_from_world.OriginInSource())
          .norm();
    };
    log_ratio += std::log(error(knowing) / error({})) / kProblems;
  }
  EXPECT_LT(log_ratio, 0);
}

}  // namespace
}  // namespace raylift
