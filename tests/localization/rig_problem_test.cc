#include "localization/rig_problem.h"

#include <vector>

#include "geometry/pose_step.h"
#include "support/matchers.h"
#include "support/synthetic_problem.h"

#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

PoseProblem Photograph(const std::string& name, const std::vector<std::string>& references,
                       int first_keypoint, Rng& rng) {
  PoseProblem problem;
  problem.name = name;
  problem.query_camera =
      Camera(CameraModel::kSimplePinhole, 64, 48 + first_keypoint, std::vector<double>{50, 32, 24});
  for (const std::string& reference : references) {
    problem.references.push_back({reference, problem.query_camera, RandomRigid3(rng, 1)});
  }
  for (int i = 0; i < 4; ++i) {
    const int reference = i % static_cast<int>(references.size());
    problem.matches_2d3d.push_back({.query_px = {1.0 * i, 2},
                                    .point_in_world = {0, 0, 1.0 * i},
                                    .reference = reference,
                                    .query_keypoint = first_keypoint + i,
                                    .match_2d2d = static_cast<size_t>(i)});
    problem.matches_2d2d.push_back({.reference = reference,
                                    .query_px = {1.0 * i, 2},
                                    .reference_px = {3, 1.0 * i},
                                    .query_keypoint = first_keypoint + i});
  }
  return problem;
}

TEST(RigProblem, ReferencesAreOneByTheirNames) {
  Rng rng = TestRng();
  const PoseProblem left = Photograph("left", {"a", "b"}, 0, rng);
  const PoseProblem right = Photograph("right", {"b", "c"}, 7, rng);
  const Rigid3 left_from_rig = RandomRigid3(rng, 1);
  const Rigid3 right_from_rig = RandomRigid3(rng, 1);
  const PoseProblem joined =
      JoinProblems(std::vector{&left, &right}, std::vector{left_from_rig, right_from_rig});
  EXPECT_EQ(joined.name, "left");
  EXPECT_EQ(joined.query_camera, left.query_camera);
  ASSERT_EQ(joined.other_cameras.size(), 1u);
  EXPECT_EQ(joined.other_cameras[0].name, "right");
  EXPECT_EQ(joined.other_cameras[0].camera, right.query_camera);
  EXPECT_TRUE(IsNearPose(joined.other_cameras[0].cam_from_query * left_from_rig, right_from_rig,
                         1e-6, 1e-12));
  ASSERT_EQ(joined.references.size(), 3u);
  ASSERT_EQ(joined.matches_2d2d.size(), 8u);
  ASSERT_EQ(joined.matches_2d3d.size(), 8u);
  for (size_t i = 0; i < 8; ++i) {
    const PoseProblem& from = i < 4 ? left : right;
    const Match2D2D& pair = joined.matches_2d2d[i];
    const Match2D3D& point = joined.matches_2d3d[i];
    EXPECT_EQ(pair.camera, i < 4 ? 0 : 1);
    EXPECT_EQ(point.camera, pair.camera);
    const auto reference = static_cast<size_t>(from.matches_2d2d[i % 4].reference);
    EXPECT_EQ(joined.references[static_cast<size_t>(pair.reference)].name,
              from.references[reference].name);
    EXPECT_EQ(point.reference, pair.reference);
    EXPECT_EQ(point.match_2d2d, i);
    EXPECT_EQ(pair.query_keypoint, from.matches_2d2d[i % 4].query_keypoint);
  }
}

// By what a small step of the query's pose does to the other camera's.
TEST(RigProblem, CovarianceMovesWithTheCamera) {
  Rng rng = TestRng();
  const PoseProblem left = Photograph("left", {"a"}, 0, rng);
  const PoseProblem right = Photograph("right", {"a"}, 0, rng);
  const PoseProblem joined =
      JoinProblems(std::vector{&left, &right}, std::vector{Rigid3(), RandomRigid3(rng, 1)});
  const Rigid3& right_from_left = joined.other_cameras[0].cam_from_query;
  PoseEstimate estimate;
  estimate.cam_from_world = RandomRigid3(rng, 1);
  Eigen::Matrix<double, 6, 6> root;
  for (double& x : root.reshaped()) x = rng.Normal();
  estimate.covariance = root * root.transpose();
  estimate.inliers_2d2d =
      estimate.inliers_2d3d = {true, false, true, true, false, true, false, false};
  const PoseEstimate of_right = EstimateOfCamera(joined, estimate, 1);
  EXPECT_TRUE(IsNearPose(*of_right.cam_from_world, right_from_left * *estimate.cam_from_world, 1e-9,
                         1e-12));
  Eigen::Matrix<double, 6, 6> moved = Eigen::Matrix<double, 6, 6>::Zero();
  constexpr double kStep = 1e-6;
  for (int k = 0; k < 6; ++k) {
    const Rigid3 step{RotationFromVector(kStep * root.col(k).head<3>()),
                      kStep * root.col(k).tail<3>()};
    const Vector6d of_camera =
        StepBetween(*of_right.cam_from_world, right_from_left * step * *estimate.cam_from_world) /
        kStep;
    moved += of_camera * of_camera.transpose();
  }
  EXPECT_LT((moved - *of_right.covariance).norm(), 1e-4 * moved.norm());
  EXPECT_EQ(of_right.inliers_2d2d, (std::vector<bool>{false, true, false, false}));
  const PoseEstimate of_left = EstimateOfCamera(joined, estimate, 0);
  EXPECT_EQ(of_left.inliers_2d3d, (std::vector<bool>{true, false, true, true}));
  EXPECT_EQ(*of_left.covariance, *estimate.covariance);
}

}  // namespace
}  // namespace raylift
