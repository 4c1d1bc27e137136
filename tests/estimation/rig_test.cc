// Queries that are rigs: several cameras with known relative poses, one unknown pose.

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "estimation/problem/normalized_problem.h"
#include "estimation/ransac/samplers.h"
#include "estimation/refinement/pose_minimizer.h"
#include "estimation/standard_options.h"
#include "support/coherent_problem.h"
#include "support/matchers.h"

#include "raylift/base/error.h"
#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

#ifdef __SANITIZE_ADDRESS__
constexpr int kRigProblems = 4;
#else
constexpr int kRigProblems = 20;
#endif

constexpr Method kMethods[] = {Method::kP3p,      Method::kE5p1,         Method::kD3p1,
                               Method::kAdaptive, Method::kHybridRansac, Method::kHloc};

// What one camera of a rig sees, as a query of its own.
PoseProblem OneImage(const PoseProblem& rig, int camera) {
  PoseProblem image = rig;
  image.query_camera = rig.CameraAt(camera);
  image.other_cameras.clear();
  const auto keep = [camera](auto& matches) {
    std::erase_if(matches, [camera](const auto& match) { return match.camera != camera; });
    for (auto& match : matches) match.camera = 0;
  };
  keep(image.matches_2d2d);
  keep(image.matches_2d3d);
  for (Match2D3D& match : image.matches_2d3d) match.match_2d2d.reset();
  return image;
}

// The same rig about another of its cameras, whose pose is then the query's.
PoseProblem About(const PoseProblem& rig, int camera) {
  PoseProblem other = rig;
  RigCamera& was_other = other.other_cameras[static_cast<size_t>(camera - 1)];
  const Rigid3 query_from_new = was_other.cam_from_query.Inverse();
  std::swap(other.query_camera, was_other.camera);
  for (RigCamera& c : other.other_cameras) {
    c.cam_from_query = &c == &was_other ? query_from_new : c.cam_from_query * query_from_new;
  }
  const auto swap = [camera](auto& matches) {
    for (auto& match : matches) {
      if (match.camera == 0 || match.camera == camera) match.camera = camera - match.camera;
    }
  };
  swap(other.matches_2d2d);
  swap(other.matches_2d3d);
  return other;
}

CoherentProblem ExactRig(int num_cameras, int num_keypoints, Rng& rng) {
  return MakeCoherentProblem("exact",
                             {.num_keypoints = num_keypoints,
                              .num_references = 3,
                              .seen = 1,
                              .wrong = 0,
                              .sigma_px = 1e-4,
                              .num_cameras = num_cameras},
                             rng);
}

TEST(Rig, ResidualsAreThoseOfEachCamera) {
  Rng rng = TestRng();
  const CoherentProblem made =
      MakeCoherentProblem("rig", {.num_keypoints = 40, .num_cameras = 3}, rng);
  const NormalizedProblem prepared(made.problem, 4, 2, rng);
  const Rigid3 near = Rigid3{RotationFromVector(Vector3d(1e-3, -2e-3, 1e-3)), {0.02, 0.01, 0}} *
                      made.query_from_world;
  const Residuals residuals = ComputeResiduals(prepared, prepared.ToLocal(near));
  std::array<int, 3> compared{};
  const auto pose_of = [&](int camera) {
    return camera == 0
               ? near
               : made.problem.other_cameras[static_cast<size_t>(camera - 1)].cam_from_query * near;
  };
  for (size_t i = 0; i < prepared.matches_2d3d.size(); ++i) {
    const Match2D3D& match =
        made.problem.matches_2d3d[static_cast<size_t>(prepared.matches_2d3d[i].match)];
    const auto px = made.problem.CameraAt(match.camera)
                        .ImgFromCam(pose_of(match.camera) * match.point_in_world);
    const double squared = px ? (*px - match.query_px).squaredNorm() / 16 : 1e9;
    if (!(squared < 100)) continue;
    EXPECT_NEAR(residuals.of_2d3d[i], squared, 1e-6 * (1 + squared));
    ++compared[match.camera];
  }
  for (size_t i = 0; i < prepared.matches_2d2d.size(); ++i) {
    const Match2D2D& match =
        made.problem.matches_2d2d[static_cast<size_t>(prepared.matches_2d2d[i].match)];
    const PosedImage& reference = made.problem.references[static_cast<size_t>(match.reference)];
    const auto error =
        SampsonError(made.problem.CameraAt(match.camera), pose_of(match.camera), match.query_px,
                     reference.camera, reference.cam_from_world, match.reference_px);
    ASSERT_TRUE(error);
    const double squared = error->error_px * error->error_px / 4;
    if (!std::isfinite(residuals.of_2d2d[i])) continue;
    EXPECT_NEAR(residuals.of_2d2d[i], squared, 1e-6 * (1 + squared));
    ++compared[match.camera];
  }
  for (const int count : compared) EXPECT_GT(count, 100);
}

TEST(Rig, GradientIsHalfOfTheCostsSlope) {
  Rng rng = TestRng();
  const CoherentProblem made =
      MakeCoherentProblem("rig", {.num_keypoints = 60, .wrong = 0, .num_cameras = 3}, rng);
  const NormalizedProblem prepared(made.problem, 4, 2, rng);
  std::vector<int> points(prepared.matches_2d3d.size());
  std::vector<int> pairs(prepared.matches_2d2d.size());
  for (size_t i = 0; i < points.size(); ++i) points[i] = static_cast<int>(i);
  for (size_t i = 0; i < pairs.size(); ++i) pairs[i] = static_cast<int>(i);
  const auto of_2d3d = MakeBlocks2D3D<double>(prepared.matches_2d3d, points);
  const auto of_2d2d = MakeBlocks2D2D<double>(prepared.matches_2d2d, pairs);
  const ActiveMatches<double> matches = {of_2d3d.blocks, of_2d3d.block_camera, of_2d2d.blocks,
                                         of_2d2d.block_camera_reference};
  MatchSetWeights weights;
  weights.loss_2d3d.limit = weights.loss_2d2d.limit = 1e6;
  const CamFromLocal pose =
      Moved(prepared.ToLocal(made.query_from_world), Vector6d(1e-3 * Vector6d::Ones()));
  const NormalEquations equations = Linearize(prepared, matches, pose, weights);
  for (int k = 0; k < 6; ++k) {
    const Vector6d step = 1e-6 * Vector6d::Unit(k);
    const double slope = (Linearize(prepared, matches, Moved(pose, step), weights).cost -
                          Linearize(prepared, matches, Moved(pose, -step), weights).cost) /
                         2e-6;
    EXPECT_NEAR(equations.gradient[k], 0.5 * slope, 1e-5 * (1 + std::abs(slope)));
  }
}

TEST(Rig, EveryMethodFindsThePoseOfExactMatches) {
  Rng rng = TestRng();
  for (const int num_cameras : {2, 4, 6}) {
    const CoherentProblem made = ExactRig(num_cameras, 30, rng);
    for (const Method method : kMethods) {
      const PoseEstimate estimate = EstimateWith(method, made.problem);
      EXPECT_TRUE(IsSound(estimate, made.problem));
      EXPECT_LT(PositionErrorOrFar(estimate, made.query_from_world), 1e-3)
          << num_cameras << " " << ToString(method);
      EXPECT_EQ(estimate.verdict, PoseVerdict::kLocalized);
    }
  }
}

// No image has enough points by itself: the sample is of several cameras.
TEST(Rig, OnePointPerImageIsEnough) {
  Rng rng = TestRng();
  int right = 0;
  for (int i = 0; i < kRigProblems; ++i) {
    CoherentProblem made = ExactRig(6, 1, rng);
    made.problem.matches_2d2d.clear();
    for (Match2D3D& match : made.problem.matches_2d3d) match.match_2d2d.reset();
    std::erase_if(made.problem.matches_2d3d,
                  [](const auto& match) { return match.reference != 0; });
    ASSERT_LE(made.problem.matches_2d3d.size(), 6u);
    EstimatorOptions options = StandardOptions(Method::kP3p);
    options.refinement = Refinement::kPaper;  // so few are not beyond chance
    const PoseEstimate estimate = EstimateWith(options, made.problem);
    right += PositionErrorOrFar(estimate, made.query_from_world) < 0.01 ? 1 : 0;
  }
  EXPECT_GE(right, 0.8 * kRigProblems);  // some references see fewer than four of the points
}

// The way between the cameras stands for the second reference.
TEST(Rig, OneReferenceTellsThePositionByTheWayBetweenTheCameras) {
  Rng rng = TestRng();
  for (int i = 0; i < kRigProblems; ++i) {
    CoherentProblem made = MakeCoherentProblem("one reference",
                                               {.num_keypoints = 60,
                                                .num_references = 1,
                                                .seen = 1,
                                                .sigma_px = 0.05,
                                                .num_cameras = 3,
                                                .rig_extent = 3},
                                               rng);
    made.problem.matches_2d3d.clear();
    const PoseEstimate estimate = EstimateWith(Method::kE5p1, made.problem);
    EXPECT_TRUE(estimate.position_observable);
    EXPECT_LT(PositionErrorOrFar(estimate, made.query_from_world), 0.2);
    EXPECT_FALSE(EstimateWith(Method::kE5p1, OneImage(made.problem, 0)).position_observable);
  }
}

TEST(Rig, ItsPoseDoesNotDependOnWhichCameraIsTheQuerys) {
  Rng rng = TestRng();
  const CoherentProblem made =
      MakeCoherentProblem("rig", {.num_keypoints = 80, .num_cameras = 4}, rng);
  const PoseEstimate estimate = EstimateWith(Method::kAdaptive, made.problem);
  ASSERT_TRUE(estimate.cam_from_world);
  for (int camera = 1; camera < 4; ++camera) {
    const PoseEstimate other = EstimateWith(Method::kAdaptive, About(made.problem, camera));
    ASSERT_TRUE(other.cam_from_world);
    const Rigid3 expected =
        made.problem.other_cameras[static_cast<size_t>(camera - 1)].cam_from_query *
        *estimate.cam_from_world;
    // Both are within a small part of their standard deviation (some 5 mm) of the optimum.
    EXPECT_TRUE(IsNearPose(*other.cam_from_world, expected, 0.01, 3e-3));
    EXPECT_NEAR(other.rotation_sigma_deg, estimate.rotation_sigma_deg,
                0.1 * estimate.rotation_sigma_deg);
    EXPECT_NEAR(other.confidence, estimate.confidence, 1e-3);
  }
}

TEST(Rig, IsLocalizedWhereItsImagesAreNot) {
  Rng rng = TestRng();
  for (const int num_cameras : {2, 3, 4, 6}) {
    double right_rigs = 0, right_images = 0;
    for (int i = 0; i < kRigProblems; ++i) {
      const CoherentProblem made = MakeCoherentProblem("few",
                                                       {.num_keypoints = 10,
                                                        .num_references = 2,
                                                        .wrong = 0.7,
                                                        .sigma_px = 1,
                                                        .num_cameras = num_cameras},
                                                       rng);
      const auto is_right = [&](const PoseProblem& problem, const Rigid3& truth) {
        const PoseEstimate estimate = EstimateWith(Method::kAdaptive, problem);
        EXPECT_TRUE(IsSound(estimate, problem));
        return PositionErrorOrFar(estimate, truth) < 0.5 ? 1.0 : 0.0;
      };
      right_rigs += is_right(made.problem, made.query_from_world);
      for (int c = 0; c < num_cameras; ++c) {
        const Rigid3 truth =
            c == 0 ? made.query_from_world
                   : made.problem.other_cameras[static_cast<size_t>(c - 1)].cam_from_query *
                         made.query_from_world;
        right_images += is_right(OneImage(made.problem, c), truth) / num_cameras;
      }
    }
    EXPECT_GT(right_rigs, right_images) << num_cameras;
    RecordProperty("rigs_of_" + std::to_string(num_cameras), static_cast<int>(right_rigs));
    RecordProperty("images_of_" + std::to_string(num_cameras), static_cast<int>(right_images));
  }
}

// The squared errors over the covariance, six degrees of freedom each.
TEST(Rig, CovarianceTellsTheErrors) {
  Rng rng = TestRng();
  double sum = 0;
  for (int i = 0; i < kRigProblems; ++i) {
    const CoherentProblem made =
        MakeCoherentProblem("rig", {.num_keypoints = 60, .num_cameras = 3}, rng);
    const PoseEstimate estimate = EstimateWith(Method::kAdaptive, made.problem);
    ASSERT_TRUE(estimate.cam_from_world && estimate.covariance);
    const Vector6d error = StepBetween(*estimate.cam_from_world, made.query_from_world);
    sum += error.dot(estimate.covariance->ldlt().solve(error));
  }
  EXPECT_GT(sum / kRigProblems, 2);
  EXPECT_LT(sum / kRigProblems, 12);
}

TEST(Rig, PriorsAreOfTheQuerysOwnCamera) {
  Rng rng = TestRng();
  for (int i = 0; i < kRigProblems; ++i) {
    CoherentProblem made = ExactRig(3, 2, rng);
    made.problem.matches_2d2d.clear();
    std::erase_if(made.problem.matches_2d3d,
                  [](const auto& match) { return match.reference != 0; });
    for (Match2D3D& match : made.problem.matches_2d3d) match.match_2d2d.reset();
    const Vector3d down(0.1, -0.2, -2);
    made.problem.priors = {
        .position = PositionPrior{made.query_from_world.OriginInSource(), Vector3d::Constant(1e-3)},
        .gravity = GravityPrior{made.query_from_world.rotation * down, down, 0.01}};
    EstimatorOptions options = StandardOptions(Method::kP3p);
    options.refinement = Refinement::kPaper;
    const NormalizedProblem prepared(made.problem, 4, 2, rng);
    if (prepared.matches_2d3d.size() < 4) continue;
    EXPECT_LT(PositionErrorOrFar(EstimateWith(options, made.problem), made.query_from_world), 0.02);
  }
}

TEST(Rig, MatchesOfNoCameraCountAsOutliers) {
  Rng rng = TestRng();
  CoherentProblem made = ExactRig(2, 20, rng);
  made.problem.matches_2d3d[0].camera = 2;
  made.problem.matches_2d2d[0].camera = -1;
  const PoseEstimate estimate = EstimateWith(Method::kAdaptive, made.problem);
  EXPECT_TRUE(IsSound(estimate, made.problem));
  EXPECT_LT(PositionErrorOrFar(estimate, made.query_from_world), 1e-3);
  EXPECT_FALSE(estimate.inliers_2d3d[0]);
  EXPECT_FALSE(estimate.inliers_2d2d[0]);
}

TEST(Rig, CamerasNowhereAreLeftOut) {
  Rng rng = TestRng();
  for (const double far : {1e300, std::nan("")}) {
    CoherentProblem made = ExactRig(3, 20, rng);
    made.problem.other_cameras[1].cam_from_query.translation.x() = far;
    for (const Method method : kMethods) {
      const PoseEstimate estimate = EstimateWith(method, made.problem);
      EXPECT_TRUE(IsSound(estimate, made.problem));
      EXPECT_LT(PositionErrorOrFar(estimate, made.query_from_world), 1e-3);
    }
  }
}

TEST(Rig, FocalLengthsMustBeKnown) {
  Rng rng = TestRng();
  CoherentProblem made = ExactRig(2, 20, rng);
  made.problem.priors.focal_range = 2;
  EXPECT_TRUE(FailsWithInputError([&] { EstimateWith(Method::kAdaptive, made.problem); },
                                  {"focal lengths of a rig's cameras must be known"}));
}

}  // namespace
}  // namespace raylift
