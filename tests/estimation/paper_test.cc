// --refinement paper against plain transcriptions of the paper's equations (Sec. 3): the scores of
// the two match sets, their combinations (Eqs. 1 to 5) and Select's rule (Eq. 6), from residuals
// that geometry/residuals.h gives one by one.

#include <algorithm>
#include <cmath>
#include <vector>

#include "estimation/near_truth.h"
#include "estimation/ransac/samplers.h"
#include "support/matchers.h"
#include "support/synthetic_problem.h"

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

constexpr double kT3 = 4;  // t_3D
constexpr double kT2 = 2;  // t_2D

struct Sets {
  double inliers_3d = 0, inliers_2d = 0;  // I
  double count_3d = 0, count_2d = 0;      // N
  double msac_3d = 0, msac_2d = 0;        // M: the sum of min(e^2, t^2)
};

// Of a 2D-2D match, the points behind a camera apart: those are no inliers.
bool IsInFront(const PoseProblem& problem, const Match2D2D& match, const Rigid3& pose) {
  const PosedImage& reference = problem.references[static_cast<size_t>(match.reference)];
  const Rigid3 query_from_reference = pose * reference.cam_from_world.Inverse();
  const Eigen::Vector3d q = problem.query_camera.RayInCam(match.query_px)->normalized();
  const Eigen::Vector3d r =
      query_from_reference.rotation * reference.camera.RayInCam(match.reference_px)->normalized();
  // a q = b r + t.
  Eigen::Matrix<double, 3, 2> rays;
  rays << q, -r;
  const Eigen::Vector2d depths = rays.colPivHouseholderQr().solve(query_from_reference.translation);
  return depths[0] > 0 && depths[1] > 0;
}

Sets Score(const PoseProblem& problem, const Rigid3& pose) {
  Sets sets;
  sets.count_3d = static_cast<double>(problem.matches_2d3d.size());
  sets.count_2d = static_cast<double>(problem.matches_2d2d.size());
  for (const Match2D3D& match : problem.matches_2d3d) {
    const auto error =
        ReprojectionError(problem.query_camera, pose, match.point_in_world, match.query_px);
    const double e2 = error ? error->error_px.squaredNorm() : kT3 * kT3;
    sets.inliers_3d += e2 < kT3 * kT3 ? 1 : 0;
    sets.msac_3d += std::min(e2, kT3 * kT3);
  }
  for (const Match2D2D& match : problem.matches_2d2d) {
    const PosedImage& reference = problem.references[static_cast<size_t>(match.reference)];
    const auto error = SampsonError(problem.query_camera, pose, match.query_px, reference.camera,
                                    reference.cam_from_world, match.reference_px);
    const double e2 =
        error && IsInFront(problem, match, pose) ? error->error_px * error->error_px : kT2 * kT2;
    sets.inliers_2d += e2 < kT2 * kT2 ? 1 : 0;
    sets.msac_2d += std::min(e2, kT2 * kT2);
  }
  return sets;
}

double Combined(const Sets& s, ScoreCombination combination) {
  switch (combination) {
    case ScoreCombination::kSumInliers:
      return -(s.inliers_3d + s.inliers_2d);
    case ScoreCombination::kSumInlierRatios:
      return -(s.inliers_3d / s.count_3d + s.inliers_2d / s.count_2d);
    case ScoreCombination::kMultInliers:
      return -s.inliers_3d * s.inliers_2d;
    case ScoreCombination::kSumMsac:
      return s.msac_3d / (kT3 * kT3) + s.msac_2d / (kT2 * kT2);
    case ScoreCombination::kMultMsac:
      return s.msac_3d / (kT3 * kT3) * (s.msac_2d / (kT2 * kT2));
  }
  return 0;
}

EstimatorOptions Paper(Method method) {
  EstimatorOptions options;
  options.method = method;
  options.refinement = Refinement::kPaper;
  options.reprojection_threshold_px = kT3;
  options.sampson_threshold_px = kT2;
  return options;
}

std::vector<SyntheticProblem> Problems() {
  std::vector<SyntheticProblem> problems = MakeRegime(RegimeByName("accurate"), 3);
  for (const char* name : {"noisy_points", "few_points"}) {
    for (SyntheticProblem& made : MakeRegime(RegimeByName(name), 3)) problems.push_back(made);
  }
  return problems;
}

TEST(Paper, AdaptiveComparesPosesByItsEquations) {
  for (const SyntheticProblem& made : Problems()) {
    for (const ScoreCombination combination : AllValues<ScoreCombination>()) {
      for (const LocalOptimization local : AllValues<LocalOptimization>()) {
        EstimatorOptions options = Paper(Method::kAdaptive);
        options.score = combination;
        options.local_optimization = local;
        const PoseEstimate estimate = MakePoseEstimator(options)->Estimate(made.problem);
        ASSERT_TRUE(estimate.cam_from_world);
        const Sets sets = Score(made.problem, *estimate.cam_from_world);
        const double expected = Combined(sets, combination);
        // Scores are in single precision. A pair whose rays are parallel but for noise counts, also
        // where they meet behind the cameras: one here and there.
        Sets one_more = sets;
        one_more.inliers_2d += 1;
        const double of_one = std::abs(Combined(one_more, combination) - expected);
        EXPECT_NEAR(estimate.ransac_value, expected, of_one + 2e-3 * std::abs(expected) + 1e-3)
            << ToString(combination);
        EXPECT_EQ(estimate.refined_value, estimate.ransac_value) << "nothing is refined";
      }
    }
  }
}

TEST(Paper, TheBaselinesCompareTheirOwnMsacScore) {
  for (const SyntheticProblem& made : Problems()) {
    const PoseEstimate p3p = MakePoseEstimator(Paper(Method::kP3p))->Estimate(made.problem);
    ASSERT_TRUE(p3p.cam_from_world);
    const double msac_3d = Score(made.problem, *p3p.cam_from_world).msac_3d / (kT3 * kT3);
    EXPECT_NEAR(p3p.ransac_value, msac_3d, 2e-3 * msac_3d);
    const PoseEstimate e5p1 = MakePoseEstimator(Paper(Method::kE5p1))->Estimate(made.problem);
    ASSERT_TRUE(e5p1.cam_from_world);
    const double msac_2d = Score(made.problem, *e5p1.cam_from_world).msac_2d / (kT2 * kT2);
    EXPECT_NEAR(e5p1.ransac_value, msac_2d, 2e-3 * msac_2d);
  }
}

TEST(Paper, SelectTakesThePoseThatItsRuleNames) {
  for (const SyntheticProblem& made : Problems()) {
    for (const double alpha : {0.7, 0.8, 0.9, 1.0}) {
      EstimatorOptions options = Paper(Method::kSelect);
      options.alpha = alpha;
      const PoseEstimate selected = MakePoseEstimator(options)->Estimate(made.problem);
      const PoseEstimate p3p = MakePoseEstimator(Paper(Method::kP3p))->Estimate(made.problem);
      const PoseEstimate e5p1 = MakePoseEstimator(Paper(Method::kE5p1))->Estimate(made.problem);
      ASSERT_TRUE(selected.cam_from_world && p3p.cam_from_world && e5p1.cam_from_world);
      const bool takes_p3p = Score(made.problem, *p3p.cam_from_world).inliers_2d >
                             alpha * Score(made.problem, *e5p1.cam_from_world).inliers_2d;
      const Rigid3& expected = takes_p3p ? *p3p.cam_from_world : *e5p1.cam_from_world;
      EXPECT_TRUE(IsNearPose(*selected.cam_from_world, expected, 0, 0));
    }
  }
}

// "one [sample] from the 2D-2D matches for the E5+1 solver": five matches and one more, so that a
// sample is right if all six are, and has no more poses than the five-point solver.
TEST(Paper, E5p1DrawsFiveMatchesAndOneMore) {
  Rng rng = TestRng();
  const NearTruth near = MakeNearTruth(rng, {});
  const NormalizedProblem& problem = near.prepared;
  const E5p1Sampler sampler(problem, SixthMatchesPerSample(Refinement::kPaper));
  InlierCounts inliers;
  inliers.of_2d2d.assign(problem.num_camera_references(), 0);
  double all_inliers = 0;
  for (const MatchGroup& group : problem.groups_2d2d) {
    inliers.of_2d2d[static_cast<size_t>(group.camera_reference)] = group.size() / 2;
    all_inliers += group.size() / 2;
  }
  double expected = 0;
  const auto num_matches = static_cast<double>(problem.matches_2d2d.size());
  for (const MatchGroup& group : problem.groups_2d2d) {
    const double size = group.size();
    const double own = inliers.of_2d2d[static_cast<size_t>(group.camera_reference)];
    expected +=
        size / num_matches * std::pow(own / size, 5) * (all_inliers - own) / (num_matches - size);
  }
  EXPECT_NEAR(sampler.SuccessProbability(inliers), expected, 1e-12);
  std::vector<CamFromLocal> poses;
  for (int i = 0; i < 200; ++i) {
    sampler.Sample(rng, poses);
    EXPECT_LE(poses.size(), 10u);
  }
}

}  // namespace
}  // namespace raylift
