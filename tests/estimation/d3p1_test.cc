// D3+1 as a method, and in Adaptive: depth whose scale is each reference's own.

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "estimation/kernels/kernel_table.h"
#include "estimation/standard_options.h"
#include "support/coherent_problem.h"
#include "support/matchers.h"

namespace raylift {
namespace {

#ifdef __SANITIZE_ADDRESS__
constexpr int kD3p1Problems = 5;
#else
constexpr int kD3p1Problems = 30;
#endif

// As of single images: each reference's depths have a factor of their own, of any size.
CoherentOptions UnknownScale() {
  return {.num_keypoints = 150, .num_references = 4, .vertical = 0.5, .reference_factor = 0.7};
}

int Sum(const std::vector<int>& counts) {
  int sum = 0;
  for (const int count : counts) sum += count;
  return sum;
}

// Moves each lifted point along its ray by its reference's factor.
PoseProblem WithFactors(const PoseProblem& problem, const std::vector<double>& factors) {
  PoseProblem scaled = problem;
  for (Match2D3D& match : scaled.matches_2d3d) {
    const auto reference = static_cast<size_t>(match.reference.value());
    const Eigen::Vector3d center = problem.references[reference].cam_from_world.OriginInSource();
    match.point_in_world = center + factors[reference] * (match.point_in_world - center);
  }
  return scaled;
}

TEST(D3p1, FindsThePoseWhereScalesAreUnknown) {
  Rng rng = TestRng();
  double log_ratio = 0;  // of its position errors to those of E5+1, mean
  for (int i = 0; i < kD3p1Problems; ++i) {
    const CoherentProblem made = MakeCoherentProblem("scales", UnknownScale(), rng);
    const PoseEstimate estimate = EstimateWith(Method::kD3p1, made.problem);
    ASSERT_TRUE(estimate.cam_from_world);
    EXPECT_TRUE(IsSound(estimate, made.problem));
    EXPECT_EQ(estimate.solver, Solver::kD3p1);
    EXPECT_EQ(estimate.verdict, PoseVerdict::kLocalized);
    EXPECT_TRUE(estimate.position_observable && estimate.covariance);
    // The scene is 20 m away.
    EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, made.query_from_world, 0.3, 0.15));
    const PoseEstimate e5p1 = EstimateWith(Method::kE5p1, made.problem);
    log_ratio += std::log(PositionError(estimate, made.query_from_world) /
                          PositionError(e5p1, made.query_from_world)) /
                 kD3p1Problems;
  }
  // Depths of one reference agree, which pairs alone do not tell. Less than nothing by two standard
  // deviations of the mean of logarithms that vary by some 0.6.
  EXPECT_LT(log_ratio, 2 * 0.6 / std::sqrt(kD3p1Problems));
}

TEST(D3p1, TheScaleOfAReferencesDepthsChangesNoSample) {
  Rng rng = TestRng();
  for (int i = 0; i < kD3p1Problems; ++i) {
    const CoherentProblem made =
        MakeCoherentProblem("factors", {.num_keypoints = 150, .num_references = 4}, rng);
    EstimatorOptions options = StandardOptions(Method::kD3p1);
    options.refinement = Refinement::kPaper;
    const PoseEstimate metric = EstimateWith(options, made.problem);
    const PoseEstimate scaled = EstimateWith(options, WithFactors(made.problem, {0.1, 2, 1, 30}));
    ASSERT_TRUE(metric.cam_from_world && scaled.cam_from_world);
    EXPECT_EQ(scaled.iterations, metric.iterations);
    EXPECT_TRUE(IsNearPose(*scaled.cam_from_world, *metric.cam_from_world, 1e-6, 1e-6));
  }
}

TEST(D3p1, NeedsFewerSamplesThanE5p1) {
  Rng rng = TestRng();
  CoherentOptions hard = UnknownScale();
  hard.wrong = 0.6;
  std::vector<int> d3p1, e5p1, adaptive, without_depth;
  for (int i = 0; i < kD3p1Problems; ++i) {
    const CoherentProblem made = MakeCoherentProblem("wrong", hard, rng);
    const auto iterations = [&made](Method method, const PoseProblem& problem) {
      const PoseEstimate estimate = EstimateWith(method, problem);
      EXPECT_TRUE(IsNearPose(estimate.cam_from_world.value(), made.query_from_world, 1, 0.5));
      return estimate.iterations;
    };
    d3p1.push_back(iterations(Method::kD3p1, made.problem));
    e5p1.push_back(iterations(Method::kE5p1, made.problem));
    adaptive.push_back(iterations(Method::kAdaptive, made.problem));
    PoseProblem pairs = made.problem;
    pairs.matches_2d3d.clear();
    without_depth.push_back(iterations(Method::kAdaptive, pairs));
  }
  EXPECT_LT(2 * Sum(d3p1), Sum(e5p1));
  EXPECT_LT(2 * Sum(adaptive), Sum(without_depth));
}

TEST(D3p1, SaysWhereThereIsNothingToSample) {
  Rng rng = TestRng();
  const CoherentProblem made = MakeCoherentProblem("none", UnknownScale(), rng);
  PoseProblem off_rays = made.problem;  // beyond the threshold
  for (Match2D3D& match : off_rays.matches_2d3d) match.point_in_world.y() += 0.5;
  PoseProblem one_reference = made.problem;
  std::erase_if(one_reference.matches_2d2d,
                [](const Match2D2D& match) { return match.reference != 0; });
  for (Match2D3D& match : one_reference.matches_2d3d) match.match_2d2d.reset();
  for (const PoseProblem& problem : {off_rays, one_reference}) {
    const PoseEstimate estimate = EstimateWith(Method::kD3p1, problem);
    EXPECT_TRUE(IsSound(estimate, problem));
    EXPECT_EQ(estimate.failure, FailureReason::kNoDepthPair);
    EXPECT_EQ(estimate.iterations, 0);
  }
  PoseProblem pairs = made.problem;
  pairs.matches_2d3d.clear();
  EXPECT_EQ(EstimateWith(Method::kD3p1, pairs).failure, FailureReason::kTooFewMatches);
}

TEST(D3p1, FindsLiftedMatchesWithoutTheirIndices) {
  Rng rng = TestRng();
  const CoherentProblem made = MakeCoherentProblem("indices", UnknownScale(), rng);
  PoseProblem bare = made.problem;
  for (Match2D3D& match : bare.matches_2d3d) match.match_2d2d = match.reference = std::nullopt;
  std::reverse(bare.matches_2d3d.begin(), bare.matches_2d3d.end());
  const PoseEstimate estimate = EstimateWith(Method::kD3p1, bare);
  ASSERT_TRUE(estimate.cam_from_world);
  EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, made.query_from_world, 0.3, 0.15));
}

// Returns the problem with one point per keypoint, as of SfM: the mean of what the references lift,
// off the rays of all of them, and given as each reference's.
PoseProblem WithMeanPoints(const PoseProblem& problem) {
  struct Sum {
    Eigen::Vector3d of_points = Eigen::Vector3d::Zero();
    int count = 0;
  };
  std::map<int, Sum> sums;
  for (const Match2D3D& match : problem.matches_2d3d) {
    Sum& sum = sums[match.query_keypoint.value()];
    sum.of_points += match.point_in_world;
    ++sum.count;
  }
  PoseProblem meant = problem;
  for (Match2D3D& match : meant.matches_2d3d) {
    const Sum& sum = sums.at(*match.query_keypoint);
    match.point_in_world = sum.of_points / sum.count;
  }
  return meant;
}

TEST(D3p1, SolvesByPointsOfSfmWhatItSolvesByTheMeshs) {
  Rng rng = TestRng();
  for (int i = 0; i < kD3p1Problems; ++i) {
    const CoherentProblem made = MakeCoherentProblem(
        "sfm", {.num_keypoints = 150, .num_references = 4, .vertical = 0.5, .wrong = 0}, rng);
    for (const PoseProblem& problem : {made.problem, WithMeanPoints(made.problem)}) {
      const PoseEstimate estimate = EstimateWith(Method::kD3p1, problem);
      ASSERT_TRUE(estimate.cam_from_world);
      EXPECT_EQ(estimate.solver, Solver::kD3p1);
      EXPECT_TRUE(IsSound(estimate, problem));
      EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, made.query_from_world, 0.3, 0.15));
    }
  }
}

TEST(D3p1, EverySimdLevelAndEveryRunGiveTheSameBytes) {
  Rng rng = TestRng();
  const CoherentProblem made = MakeCoherentProblem("bytes", UnknownScale(), rng);
  for (const Method method : {Method::kD3p1, Method::kAdaptive}) {
    OverrideSimdLevel(SimdLevel::kSse2);
    const PoseEstimate expected = EstimateWith(method, made.problem);
    EXPECT_TRUE(IsIdentical(EstimateWith(method, made.problem), expected));
    for (const auto level : {SimdLevel::kAvx2, SimdLevel::kAvx512}) {
      if (!IsSupported(level)) continue;
      OverrideSimdLevel(level);
      EXPECT_TRUE(IsIdentical(EstimateWith(method, made.problem), expected))
          << ToString(method) << " " << ToString(level);
    }
    OverrideSimdLevel(std::nullopt);
  }
}

// The paper's Adaptive knows two samples.
TEST(D3p1, IsNoSampleOfThePapersAdaptive) {
  Rng rng = TestRng();
  for (int i = 0; i < kD3p1Problems; ++i) {
    const CoherentProblem made = MakeCoherentProblem("paper", UnknownScale(), rng);
    EstimatorOptions options = StandardOptions(Method::kAdaptive);
    options.refinement = Refinement::kPaper;
    EXPECT_NE(EstimateWith(options, made.problem).solver, Solver::kD3p1);
  }
}

}  // namespace
}  // namespace raylift
