#include "raylift/comparison/query_detail.h"

#include <algorithm>
#include <cmath>

#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

size_t CountInliers2D2D(const PoseProblem& problem, const Rigid3& cam_from_world,
                        double threshold_px) {
  size_t count = 0;
  for (const Match2D2D& match : problem.matches_2d2d) {
    const PosedImage& reference = problem.references[static_cast<size_t>(match.reference)];
    const auto error = SampsonError(problem.query_camera, cam_from_world, match.query_px,
                                    reference.camera, reference.cam_from_world, match.reference_px);
    count += error && std::abs(error->error_px) <= threshold_px;
  }
  return count;
}

}  // namespace

QueryDetail DescribeQuery(const PoseProblem& problem, size_t hit, const PoseEstimate& estimate,
                          const EstimatorOptions& options, const Rigid3& true_cam_from_world,
                          size_t max_keypoints) {
  QueryDetail detail;
  detail.retrieved = problem.references.size();
  detail.matched = problem.matches_2d2d.size();
  detail.hit = hit;
  detail.consistent = problem.matches_2d3d.size();
  detail.inliers_2d3d = static_cast<size_t>(std::max(0, estimate.score_2d3d.num_inliers));
  detail.inliers_2d2d = static_cast<size_t>(std::max(0, estimate.score_2d2d.num_inliers));
  detail.cam_from_world = estimate.cam_from_world;
  if (estimate.cam_from_world) detail.solver = ToString(estimate.solver);
  const auto add_candidate = [&](Solver solver, const std::optional<Rigid3>& pose) {
    if (!pose) return;
    detail.candidates.push_back({std::string(ToString(solver)),
                                 ComparePoses(*pose, true_cam_from_world),
                                 CountInliers2D2D(problem, *pose, options.sampson_threshold_px),
                                 estimate.cam_from_world && estimate.solver == solver});
  };
  add_candidate(Solver::kP3p, estimate.p3p_cam_from_world);
  add_candidate(Solver::kE5p1, estimate.e5p1_cam_from_world);
  const size_t count = problem.matches_2d3d.size();
  const size_t stride = max_keypoints > 0 ? count / max_keypoints + 1 : count + 1;
  for (size_t i = 0; max_keypoints > 0 && i < count; i += stride) {
    const bool is_inlier = i < estimate.inliers_2d3d.size() && estimate.inliers_2d3d[i];
    detail.keypoints.push_back({problem.matches_2d3d[i].query_px, is_inlier});
  }
  return detail;
}

}  // namespace raylift
