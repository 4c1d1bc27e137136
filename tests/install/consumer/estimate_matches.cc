#include <cstdio>

#include <raylift/estimation/options.h>
#include <raylift/estimation/pose_estimator.h>

int main() {
  // Where a photograph shows the corners of a cube; the last of them is mismatched.
  const double pixels[][2] = {{195, 115}, {445, 115}, {195, 365}, {445, 365},
                              {237, 157}, {403, 157}, {237, 323}, {500, 400}};
  const double points[][3] = {{0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {2, 2, 0},
                              {0, 0, 2}, {2, 0, 2}, {0, 2, 2}, {2, 2, 2}};
  const double f_cx_cy[] = {500, 320, 240};

  raylift::PoseProblem problem;
  problem.query_camera = {raylift::CameraModel::kSimplePinhole, 640, 480, f_cx_cy};
  for (int i = 0; i < 8; ++i) {
    problem.matches_2d3d.push_back({.query_px = {pixels[i][0], pixels[i][1]},
                                    .point_in_world = {points[i][0], points[i][1], points[i][2]}});
  }
  const auto estimator = raylift::MakePoseEstimator({.method = raylift::Method::kP3p});
  const raylift::PoseEstimate estimate = estimator->Estimate(problem);
  if (!estimate.cam_from_world) return 1;
  const Eigen::Vector3d center = estimate.cam_from_world->OriginInSource();
  std::printf("camera at (%.1f, %.1f, %.1f), %d of %d matches are inliers\n", center.x(),
              center.y(), center.z(), estimate.score_2d3d.num_inliers,
              estimate.score_2d3d.num_matches);
}
