// Problems on which estimators are known to loop for ever, to return NaN, to crash or to fail
// silently. One test for each.

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/constants.h"
#include "estimation/standard_options.h"
#include "support/coherent_problem.h"
#include "support/matchers.h"
#include "support/synthetic_problem.h"

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

SyntheticProblem Typical(std::string_view regime = "accurate", int index = 0) {
  return MakeRegime(RegimeByName(regime), index + 1)[static_cast<size_t>(index)];
}

// Keeps the pairs of some references, at most so many of each.
void KeepPairs(PoseProblem& problem, const std::vector<int>& counts) {
  std::vector<int> left = counts;
  left.resize(problem.references.size(), 0);
  std::erase_if(problem.matches_2d2d,
                [&left](const Match2D2D& match) { return left[match.reference]-- <= 0; });
}

TEST(DegenerateProblems, CollinearPointsGiveAReason) {
  SyntheticProblem made = Typical();
  made.problem.matches_2d2d.clear();
  const Eigen::Vector3d a = made.problem.matches_2d3d[0].point_in_world;
  const Eigen::Vector3d b = made.problem.matches_2d3d[1].point_in_world;
  double along = 0;
  for (Match2D3D& match : made.problem.matches_2d3d) {
    match.point_in_world = a + (along += 0.01) * (b - a);
  }
  for (const Method method : kEveryMethod) {
    const PoseEstimate estimate = EstimateWith(method, made.problem);
    EXPECT_TRUE(IsSound(estimate, made.problem)) << ToString(method);
    EXPECT_FALSE(estimate.cam_from_world) << ToString(method);
  }
}

TEST(DegenerateProblems, EqualPointsGiveAReason) {
  SyntheticProblem made = Typical();
  made.problem.matches_2d2d.clear();
  for (Match2D3D& match : made.problem.matches_2d3d) {
    match.point_in_world = made.problem.matches_2d3d[0].point_in_world;
  }
  for (const Method method : kEveryMethod) {
    const PoseEstimate estimate = EstimateWith(method, made.problem);
    EXPECT_TRUE(IsSound(estimate, made.problem)) << ToString(method);
    EXPECT_FALSE(estimate.cam_from_world) << ToString(method);
  }
}

TEST(DegenerateProblems, CollinearPointsDoNotHurtThePairs) {
  SyntheticProblem made = Typical();
  for (Match2D3D& match : made.problem.matches_2d3d) {
    match.point_in_world = made.problem.matches_2d3d[0].point_in_world;
  }
  for (const Method method : {Method::kAdaptive, Method::kSelect}) {
    const PoseEstimate estimate = EstimateWith(method, made.problem);
    ASSERT_TRUE(estimate.cam_from_world);
    EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, made.query_from_world, 0.2, 0.05));
  }
}

TEST(DegenerateProblems, AMatchThatIsNotFiniteIsAnOutlier) {
  const SyntheticProblem made = Typical();
  for (const Method method : kEveryMethod) {
    const PoseEstimate clean = EstimateWith(method, made.problem);
    for (const double bad : {kNan, kInfinity, -kInfinity}) {
      PoseProblem problem = made.problem;
      problem.matches_2d3d[7].point_in_world.y() = bad;
      problem.matches_2d3d[8].query_px.x() = bad;
      problem.matches_2d2d[9].query_px.x() = bad;
      problem.matches_2d2d[10].reference_px.y() = bad;
      const PoseEstimate estimate = EstimateWith(method, problem);
      ASSERT_TRUE(estimate.cam_from_world);
      EXPECT_TRUE(IsSound(estimate, problem));
      EXPECT_FALSE(estimate.inliers_2d3d[7] || estimate.inliers_2d3d[8]);
      EXPECT_FALSE(estimate.inliers_2d2d[9] || estimate.inliers_2d2d[10]);
      EXPECT_NEAR(estimate.score_2d3d.num_inliers, clean.score_2d3d.num_inliers, 4);
      EXPECT_NEAR(estimate.score_2d2d.num_inliers, clean.score_2d2d.num_inliers, 10);
      EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, made.query_from_world, 0.15, 0.03));
    }
  }
}

TEST(DegenerateProblems, OnlyBadMatchesGiveAReason) {
  SyntheticProblem made = Typical();
  for (Match2D3D& match : made.problem.matches_2d3d) match.point_in_world.x() = kNan;
  for (Match2D2D& match : made.problem.matches_2d2d) match.query_px.x() = kInfinity;
  for (const Method method : kEveryMethod) {
    const PoseEstimate estimate = EstimateWith(method, made.problem);
    EXPECT_TRUE(IsSound(estimate, made.problem));
    EXPECT_EQ(estimate.failure, FailureReason::kTooFewMatches);
  }
}

TEST(DegenerateProblems, AReferencePoseThatIsNotFiniteIsIgnored) {
  SyntheticProblem made = Typical();
  made.problem.references[3].cam_from_world.translation.x() = kNan;
  for (const Method method : kEveryMethod) {
    const PoseEstimate estimate = EstimateWith(method, made.problem);
    ASSERT_TRUE(estimate.cam_from_world);
    EXPECT_TRUE(IsSound(estimate, made.problem));
    EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, made.query_from_world, 0.15, 0.03));
  }
}

TEST(DegenerateProblems, AWrongReferenceIndexIsAnOutlier) {
  const SyntheticProblem made = Typical();
  for (const int wrong :
       {-1, 20, std::numeric_limits<int>::max(), std::numeric_limits<int>::min()}) {
    PoseProblem problem = made.problem;
    problem.matches_2d2d[5].reference = wrong;
    for (const Method method : kEveryMethod) {
      const PoseEstimate estimate = EstimateWith(method, problem);
      ASSERT_TRUE(estimate.cam_from_world);
      EXPECT_FALSE(estimate.inliers_2d2d[5]);
      EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, made.query_from_world, 0.15, 0.03));
    }
  }
}

TEST(DegenerateProblems, APointOfAReferenceThatDoesNotExistIsInNoCluster) {
  SyntheticProblem made = Typical();
  for (const int wrong :
       {-1, 20, std::numeric_limits<int>::max(), std::numeric_limits<int>::min()}) {
    made.problem.matches_2d3d[5].reference = wrong;
    const PoseEstimate estimate = EstimateWith(Method::kHloc, made.problem);
    ASSERT_TRUE(estimate.cam_from_world);
    EXPECT_TRUE(IsSound(estimate, made.problem));
    EXPECT_FALSE(estimate.inliers_2d3d[5]);
  }
}

TEST(DegenerateProblems, ClustersMayHaveAnyNumbers) {
  SyntheticProblem made = Typical();
  for (Match2D3D& match : made.problem.matches_2d3d) match.reference = 0;
  made.problem.reference_clusters.assign(made.problem.references.size(), 0);
  const PoseEstimate expected = EstimateWith(Method::kHloc, made.problem);
  ASSERT_TRUE(expected.cam_from_world);
  for (const int number : {-5, std::numeric_limits<int>::max(), std::numeric_limits<int>::min()}) {
    std::ranges::fill(made.problem.reference_clusters, number);
    EXPECT_TRUE(IsIdentical(EstimateWith(Method::kHloc, made.problem), expected)) << number;
  }
  made.problem.reference_clusters.pop_back();
  EXPECT_THROW(EstimateWith(Method::kHloc, made.problem), InputError);
}

TEST(DegenerateProblems, AnIndexOfAKeypointOutOfRangeIsTheInputsFault) {
  const SyntheticProblem made = Typical();
  for (const int wrong : {-1, std::numeric_limits<int>::max(), std::numeric_limits<int>::min()}) {
    PoseProblem problem = made.problem;
    problem.matches_2d3d[5].query_keypoint = wrong;
    EXPECT_THROW(EstimateWith(Method::kP3p, problem), InputError);
    problem = made.problem;
    problem.matches_2d2d[5].query_keypoint = wrong;
    EXPECT_THROW(EstimateWith(Method::kP3p, problem), InputError);
  }
}

TEST(DegenerateProblems, NoReferenceWithFiveMatchesEndsAtOnce) {
  SyntheticProblem made = Typical();
  KeepPairs(made.problem, {4, 4});
  const PoseEstimate estimate = EstimateWith(Method::kE5p1, made.problem);
  EXPECT_FALSE(estimate.cam_from_world);
  EXPECT_EQ(estimate.failure, FailureReason::kNoReferencePair);
  EXPECT_EQ(estimate.iterations, 0);
  for (const Method method : {Method::kAdaptive, Method::kSelect}) {
    const PoseEstimate other = EstimateWith(method, made.problem);
    ASSERT_TRUE(other.cam_from_world);
    EXPECT_TRUE(IsNearPose(*other.cam_from_world, made.query_from_world, 0.15, 0.03));
  }
}

// One reference, or only one with matches: rotation and direction are determined.
TEST(DegenerateProblems, OneReferenceGivesTheRotationAndSaysSo) {
  for (const bool drop_others : {false, true}) {
    SyntheticOptions options;
    options.num_references = 1;
    options.num_2d2d = 200;
    Rng rng = TestRng();
    SyntheticProblem made = MakeSyntheticProblem("one", options, rng);
    if (drop_others) {
      made = Typical();
      KeepPairs(made.problem, {200});
    }
    const PoseEstimate estimate = EstimateWith(Method::kE5p1, made.problem);
    ASSERT_TRUE(estimate.cam_from_world);
    EXPECT_FALSE(estimate.position_observable);
    EXPECT_FALSE(estimate.covariance);
    EXPECT_LT(AngleBetweenDeg(estimate.cam_from_world->rotation, made.query_from_world.rotation),
              0.5);
    EXPECT_LT(estimate.iterations, 1000);
    const PoseEstimate adaptive = EstimateWith(Method::kAdaptive, made.problem);
    ASSERT_TRUE(adaptive.cam_from_world);
    EXPECT_TRUE(adaptive.position_observable) << "the points give the position";
    EXPECT_TRUE(IsNearPose(*adaptive.cam_from_world, made.query_from_world, 0.15, 0.03));
  }
}

TEST(DegenerateProblems, AFewPointsWithoutPairsAreEnough) {
  SyntheticOptions options;
  options.num_2d2d = 0;
  options.outlier_ratio_2d3d = {0, 0};
  options.sigma_px = 0.01;
  Rng rng = TestRng();
  for (const int count : {4, 5}) {
    options.num_2d3d = count;
    int solved = 0;
    for (int trial = 0; trial < 20; ++trial) {
      const SyntheticProblem made = MakeSyntheticProblem("few", options, rng);
      const PoseEstimate estimate = EstimateWith(Method::kAdaptive, made.problem);
      ASSERT_TRUE(estimate.cam_from_world);
      solved += IsNearPose(*estimate.cam_from_world, made.query_from_world, 0.5, 0.1) ? 1 : 0;
    }
    EXPECT_GE(solved, 18) << count;
  }
  // Three points have up to four solutions: one of them comes back.
  options.num_2d3d = 3;
  for (int trial = 0; trial < 20; ++trial) {
    const SyntheticProblem made = MakeSyntheticProblem("three", options, rng);
    const PoseEstimate estimate = EstimateWith(Method::kAdaptive, made.problem);
    ASSERT_TRUE(estimate.cam_from_world);
    EXPECT_EQ(estimate.score_2d3d.num_inliers, 3);
  }
}

TEST(DegenerateProblems, NoMatchesGiveAReason) {
  SyntheticProblem made = Typical();
  made.problem.matches_2d2d.clear();
  made.problem.matches_2d3d.resize(2);
  for (const Method method : kEveryMethod) {
    EXPECT_EQ(EstimateWith(method, made.problem).failure, FailureReason::kTooFewMatches);
  }
  made.problem.matches_2d3d.clear();
  made.problem.references.clear();
  for (const Method method : kEveryMethod) {
    const PoseEstimate estimate = EstimateWith(method, made.problem);
    EXPECT_EQ(estimate.failure, FailureReason::kTooFewMatches);
    EXPECT_EQ(estimate.iterations, 0);
  }
}

TEST(DegenerateProblems, AFocalLengthOfZeroIsNoCamera) {
  const double zero[] = {0, 320, 240};
  EXPECT_THROW(Camera(CameraModel::kSimplePinhole, 640, 480, zero), InputError);
}

// The same problem in another unit: the same pose up to that unit.
class EveryUnit : public ::testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Units, EveryUnit, ::testing::Values(1e-3, 1e3, 1e-4, 1e6),
                         [](const auto& test) {
                           return "OneMetreIs1e" + std::string(test.param < 1 ? "Minus" : "") +
                                  std::to_string(std::abs(std::lround(std::log10(test.param))));
                         });

TEST_P(EveryUnit, ResultsDoNotDependOnTheUnit) {
  for (const std::string_view regime : {"accurate", "many_outliers", "few_points"}) {
    const SyntheticProblem made = Typical(regime);
    PoseProblem scaled = made.problem;
    for (PosedImage& r : scaled.references) r.cam_from_world.translation *= GetParam();
    for (Match2D3D& m : scaled.matches_2d3d) m.point_in_world *= GetParam();
    for (const Method method : kEveryMethod) {
      const PoseEstimate in_meters = EstimateWith(method, made.problem);
      PoseEstimate in_units = EstimateWith(method, scaled);
      ASSERT_TRUE(in_meters.cam_from_world && in_units.cam_from_world);
      in_units.cam_from_world->translation /= GetParam();
      EXPECT_EQ(in_units.iterations, in_meters.iterations);
      EXPECT_EQ(in_units.inliers_2d2d, in_meters.inliers_2d2d);
      EXPECT_TRUE(IsNearPose(*in_units.cam_from_world, *in_meters.cam_from_world, 1e-6, 1e-7));
      EXPECT_NEAR(in_units.position_sigma / GetParam(), in_meters.position_sigma,
                  1e-6 * in_meters.position_sigma);
    }
  }
}

TEST(DegenerateProblems, ADistantWorldOriginCostsNoAccuracy) {
  for (const std::string_view regime : {"accurate", "many_outliers", "few_points"}) {
    const SyntheticProblem made = Typical(regime);
    // The world moved by 5e6 m, as with map coordinates.
    const Eigen::Vector3d offset(3e6, -4e6, 100);
    const auto moved = [&offset](const Rigid3& cam_from_world) {
      return Rigid3{cam_from_world.rotation,
                    cam_from_world.translation - cam_from_world.rotation * offset};
    };
    PoseProblem far = made.problem;
    for (PosedImage& r : far.references) r.cam_from_world = moved(r.cam_from_world);
    for (Match2D3D& m : far.matches_2d3d) m.point_in_world += offset;
    for (const Method method : kEveryMethod) {
      const PoseEstimate near_origin = EstimateWith(method, made.problem);
      const PoseEstimate far_away = EstimateWith(method, far);
      ASSERT_TRUE(near_origin.cam_from_world && far_away.cam_from_world);
      // A double holds 5e6 m to 1e-9 m; a rotation in double turns that into as much again.
      EXPECT_LT(
          AngleBetweenDeg(far_away.cam_from_world->rotation, near_origin.cam_from_world->rotation),
          1e-4);
      EXPECT_LT((far_away.cam_from_world->OriginInSource() - offset -
                 near_origin.cam_from_world->OriginInSource())
                    .norm(),
                1e-4);
      EXPECT_NEAR(far_away.score_2d2d.num_inliers, near_origin.score_2d2d.num_inliers, 2);
    }
  }
}

TEST(DegenerateProblems, ASharedCenterGivesTheRotationAndSaysSo) {
  for (int i = 0; i < 5; ++i) {
    const SyntheticProblem made = Typical("shared_centre", i);
    const PoseEstimate estimate = EstimateWith(Method::kE5p1, made.problem);
    ASSERT_TRUE(estimate.cam_from_world);
    EXPECT_FALSE(estimate.position_observable);
    EXPECT_FALSE(estimate.covariance);
    EXPECT_EQ(estimate.position_sigma, 0);
    EXPECT_LT(AngleBetweenDeg(estimate.cam_from_world->rotation, made.query_from_world.rotation),
              1);
    const PoseEstimate adaptive = EstimateWith(Method::kAdaptive, made.problem);
    ASSERT_TRUE(adaptive.cam_from_world);
    EXPECT_TRUE(adaptive.position_observable);
    EXPECT_TRUE(IsNearPose(*adaptive.cam_from_world, made.query_from_world, 0.3, 0.05));
  }
}

TEST(DegenerateProblems, OutliersAloneEndInTime) {
  SyntheticOptions options;
  options.outlier_ratio_2d3d = options.outlier_ratio_2d2d = {1, 1};
  Rng rng = TestRng();
  for (int trial = 0; trial < 3; ++trial) {
    const SyntheticProblem made = MakeSyntheticProblem("outliers", options, rng);
    for (const Method method : kEveryMethod) {
      EstimatorOptions limited = StandardOptions(method);
      limited.max_iterations = 1000;
      const PoseEstimate estimate = EstimateWith(limited, made.problem);
      EXPECT_TRUE(IsSound(estimate, made.problem));
      // Select runs RANSAC twice, HLoc once for each cluster: here each reference is one.
      const int runs = method == Method::kHloc ? options.num_references : 2;
      EXPECT_LE(estimate.iterations, runs * limited.max_iterations);
      if (estimate.cam_from_world) {
        EXPECT_LT(estimate.score_2d3d.num_inliers + estimate.score_2d2d.num_inliers, 150)
            << "few matches fall together by chance";
      }
    }
  }
}

// The distance hangs on a few matches of the other reference, which leave it next to unbounded.
TEST(DegenerateProblems, PairsOfNextToOneReferenceAreSound) {
  Rng rng = TestRng();
  for (int i = 0; i < 60; ++i) {
    CoherentProblem made = MakeCoherentProblem(
        std::to_string(i),
        {.num_keypoints = 200, .num_references = 2, .baseline = 1, .wrong = 0.5, .sigma_px = 1.5},
        rng);
    made.problem.matches_2d3d.clear();
    KeepPairs(made.problem, {200, i % 6});
    EXPECT_TRUE(IsSound(EstimateWith(Method::kAdaptive, made.problem), made.problem)) << i;
  }
}

TEST(DegenerateProblems, TheQueryAtAReferencesCenterIsSolved) {
  SyntheticOptions options;
  options.layout = ReferenceLayout::kCoincident;
  options.sigma_px = 0;
  options.outlier_ratio_2d3d = options.outlier_ratio_2d2d = {0, 0};
  Rng rng = TestRng();
  const SyntheticProblem made = MakeSyntheticProblem("coincident", options, rng);
  for (const Method method : kEveryMethod) {
    const PoseEstimate estimate = EstimateWith(method, made.problem);
    ASSERT_TRUE(estimate.cam_from_world);
    EXPECT_TRUE(IsSound(estimate, made.problem));
    EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, made.query_from_world, 1e-3, 1e-3));
  }
}

}  // namespace
}  // namespace raylift
