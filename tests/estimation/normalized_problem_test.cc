// What an estimator sees of a problem: equal in any unit and frame, with the residuals of the
// reference implementations.

#include "estimation/problem/normalized_problem.h"

#include <cmath>
#include <limits>
#include <set>
#include <vector>

#include "support/matchers.h"
#include "support/synthetic_problem.h"

#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

constexpr double kReprojectionPx = 8;
constexpr double kSampsonPx = 2;

SyntheticProblem MakeProblem(Rng& rng) {
  SyntheticOptions options;
  options.num_2d3d = 60;
  options.num_2d2d = 90;
  options.num_references = 5;
  return MakeSyntheticProblem("normalized", options, rng);
}

NormalizedProblem Normalized(const PoseProblem& problem) {
  Rng rng(1);
  return {problem, kReprojectionPx, kSampsonPx, rng};
}

TEST(NormalizedProblem, IsCenteredOnTheReferencesThatHaveMatches) {
  Rng rng = TestRng();
  PoseProblem problem = MakeProblem(rng).problem;
  PosedImage far = problem.references.front();
  far.cam_from_world.translation.array() += 1000;
  problem.references.push_back(far);
  const NormalizedProblem normalized = Normalized(problem);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double squares = 0;
  ASSERT_EQ(normalized.centers.size(), 6u);
  for (size_t i = 0; i < 5; ++i) mean += normalized.centers[i] / 5;
  for (size_t i = 0; i < 5; ++i) squares += normalized.centers[i].squaredNorm() / 5;
  EXPECT_LT(mean.norm(), 1e-12);
  EXPECT_NEAR(squares, 1, 1e-12);
}

TEST(NormalizedProblem, IsTheSameInAnyUnitAndFrame) {
  Rng rng = TestRng();
  const PoseProblem problem = MakeProblem(rng).problem;
  constexpr double kUnit = 1000;
  const Eigen::Vector3d shift(3e5, 5e6, 100);
  PoseProblem moved = problem;
  for (PosedImage& reference : moved.references) {
    Rigid3& pose = reference.cam_from_world;
    pose.translation = kUnit * pose.translation - pose.rotation * shift;
  }
  for (Match2D3D& match : moved.matches_2d3d) {
    match.point_in_world = kUnit * match.point_in_world + shift;
  }
  const NormalizedProblem before = Normalized(problem);
  const NormalizedProblem after = Normalized(moved);
  EXPECT_NEAR(after.scale, kUnit * before.scale, 1e-6 * after.scale);
  ASSERT_EQ(before.matches_2d3d.size(), after.matches_2d3d.size());
  for (size_t i = 0; i < before.matches_2d3d.size(); ++i) {
    EXPECT_TRUE(after.matches_2d3d[i].point.isApprox(before.matches_2d3d[i].point, 1e-9));
    EXPECT_EQ(after.matches_2d3d[i].ray, before.matches_2d3d[i].ray);
  }
  for (size_t i = 0; i < before.centers.size(); ++i) {
    EXPECT_LT((after.centers[i] - before.centers[i]).norm(), 1e-9);
  }
}

TEST(NormalizedProblem, PosesGoToTheLocalFrameAndBack) {
  Rng rng = TestRng();
  const SyntheticProblem made = MakeProblem(rng);
  const NormalizedProblem normalized = Normalized(made.problem);
  const Rigid3 back = normalized.ToWorld(normalized.ToLocal(made.query_from_world));
  EXPECT_LT(StepBetween(made.query_from_world, back).norm(), 1e-12);
}

TEST(NormalizedProblem, ResidualsAreThoseOfTheReferenceImplementations) {
  Rng rng = TestRng();
  const SyntheticProblem made = MakeProblem(rng);
  const PoseProblem& problem = made.problem;
  const NormalizedProblem normalized = Normalized(problem);
  const Residuals residuals =
      ComputeResiduals(normalized, normalized.ToLocal(made.query_from_world));
  ASSERT_EQ(residuals.of_2d3d.size(), problem.matches_2d3d.size());
  ASSERT_EQ(residuals.of_2d2d.size(), problem.matches_2d2d.size());
  for (size_t i = 0; i < residuals.of_2d3d.size(); ++i) {
    const auto index = static_cast<size_t>(normalized.matches_2d3d[i].match);
    const Match2D3D& match = problem.matches_2d3d[index];
    const auto expected = ReprojectionError(problem.query_camera, made.query_from_world,
                                            match.point_in_world, match.query_px);
    if (!expected) continue;
    const double ratio = expected->error_px.norm() / kReprojectionPx;
    EXPECT_NEAR(std::sqrt(residuals.of_2d3d[i]), ratio, 1e-9 * (1 + ratio));
  }
  for (size_t i = 0; i < residuals.of_2d2d.size(); ++i) {
    const auto index = static_cast<size_t>(normalized.matches_2d2d[i].match);
    const Match2D2D& match = problem.matches_2d2d[index];
    const PosedImage& reference = problem.references[static_cast<size_t>(match.reference)];
    const auto expected =
        SampsonError(problem.query_camera, made.query_from_world, match.query_px, reference.camera,
                     reference.cam_from_world, match.reference_px);
    ASSERT_TRUE(expected);
    if (!std::isfinite(residuals.of_2d2d[i])) continue;  // behind a camera
    const double ratio = std::abs(expected->error_px) / kSampsonPx;
    EXPECT_NEAR(std::sqrt(residuals.of_2d2d[i]), ratio, 1e-6 * (1 + ratio));
  }
}

TEST(NormalizedProblem, WhatCannotCountStaysInTheTotals) {
  Rng rng = TestRng();
  PoseProblem problem = MakeProblem(rng).problem;
  problem.matches_2d3d[3].point_in_world.x() = std::numeric_limits<double>::quiet_NaN();
  problem.matches_2d3d[4].camera = 1;  // there is none
  problem.matches_2d2d[5].reference = 5;
  problem.matches_2d2d[6].query_px.y() = std::numeric_limits<double>::infinity();
  const NormalizedProblem normalized = Normalized(problem);
  EXPECT_EQ(normalized.num_matches_2d3d, 60);
  EXPECT_EQ(normalized.num_matches_2d2d, 90);
  EXPECT_EQ(normalized.matches_2d3d.size(), 58u);
  EXPECT_EQ(normalized.matches_2d2d.size(), 88u);
}

TEST(NormalizedProblem, GroupsHoldTheMatchesOfEachReference) {
  Rng rng = TestRng();
  const NormalizedProblem normalized = Normalized(MakeProblem(rng).problem);
  int next = 0;
  std::set<int> references;
  for (const MatchGroup& group : normalized.groups_2d2d) {
    EXPECT_EQ(group.begin, next);
    EXPECT_GT(group.size(), 0);
    EXPECT_TRUE(references.insert(group.reference).second);
    for (int i = group.begin; i < group.end; ++i) {
      EXPECT_EQ(normalized.matches_2d2d[static_cast<size_t>(i)].reference, group.reference);
    }
    next = group.end;
  }
  EXPECT_EQ(next, 90);
}

// To first order a longer focal length moves all pixels towards the principal point.
TEST(NormalizedProblem, AFocalErrorIsAnotherCamera) {
  Rng rng = TestRng();
  PoseProblem problem = MakeProblem(rng).problem;
  constexpr double kShare = 1e-4;
  NormalizedProblem changed = Normalized(problem);
  changed.TakeFocalSigma(problem, 0.01);
  changed.TakeFocalError(kShare);
  const Camera& camera = problem.query_camera;
  std::vector<double> params(camera.params().begin(), camera.params().end());
  for (int i = 0; i < GetCameraModelInfo(camera.model()).num_focal_lengths; ++i) {
    params[static_cast<size_t>(i)] *= 1 + kShare;
  }
  problem.query_camera = Camera(camera.model(), camera.width_px(), camera.height_px(), params);
  const NormalizedProblem expected = Normalized(problem);
  for (size_t i = 0; i < expected.matches_2d3d.size(); ++i) {
    EXPECT_LT((changed.matches_2d3d[i].ray - expected.matches_2d3d[i].ray).norm(), 1e-7);
  }
  for (size_t i = 0; i < expected.matches_2d2d.size(); ++i) {
    EXPECT_LT((changed.matches_2d2d[i].query_ray - expected.matches_2d2d[i].query_ray).norm(),
              1e-7);
  }
}

}  // namespace
}  // namespace raylift
