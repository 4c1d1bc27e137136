#include "localization/rig_problem.h"

#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "geometry/pose_step.h"

namespace raylift {
namespace {

// Adds one photograph's matches, with the indices of the joined problem.
void AddMatches(const PoseProblem& photograph, int camera,
                std::map<std::string, int>& index_of_name, PoseProblem& joined) {
  std::vector<int> index_of_reference;
  for (const PosedImage& reference : photograph.references) {
    const auto [index, is_new] =
        index_of_name.try_emplace(reference.name, static_cast<int>(joined.references.size()));
    if (is_new) joined.references.push_back(reference);
    index_of_reference.push_back(index->second);
  }
  const size_t first_pair = joined.matches_2d2d.size();
  for (Match2D2D match : photograph.matches_2d2d) {
    match.reference = index_of_reference[static_cast<size_t>(match.reference)];
    match.camera = camera;
    joined.matches_2d2d.push_back(match);
  }
  for (Match2D3D match : photograph.matches_2d3d) {
    if (match.reference) {
      match.reference = index_of_reference[static_cast<size_t>(*match.reference)];
    }
    if (match.match_2d2d) *match.match_2d2d += first_pair;
    match.camera = camera;
    joined.matches_2d3d.push_back(match);
  }
}

template <typename Match>
std::vector<bool> OfCamera(const std::vector<bool>& inliers, const std::vector<Match>& matches,
                           int camera) {
  std::vector<bool> of_camera;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (matches[i].camera == camera) of_camera.push_back(inliers[i]);
  }
  return of_camera;
}

}  // namespace

PoseProblem JoinProblems(std::span<const PoseProblem* const> photographs,
                         std::span<const Rigid3> cam_from_rig) {
  const PoseProblem& own = *photographs.front();
  PoseProblem joined;
  joined.name = own.name;
  joined.query_camera = own.query_camera;
  joined.priors = own.priors;
  const Rigid3 rig_from_query = cam_from_rig.front().Inverse();
  std::map<std::string, int> index_of_name;
  for (size_t i = 0; i < photographs.size(); ++i) {
    const PoseProblem& photograph = *photographs[i];
    if (i > 0) {
      joined.other_cameras.push_back(
          {photograph.name, photograph.query_camera, cam_from_rig[i] * rig_from_query});
    }
    AddMatches(photograph, static_cast<int>(i), index_of_name, joined);
  }
  return joined;
}

PoseEstimate EstimateOfCamera(const PoseProblem& joined, const PoseEstimate& estimate, int camera) {
  PoseEstimate of_camera = estimate;
  of_camera.inliers_2d2d = OfCamera(estimate.inliers_2d2d, joined.matches_2d2d, camera);
  of_camera.inliers_2d3d = OfCamera(estimate.inliers_2d3d, joined.matches_2d3d, camera);
  if (camera == 0) return of_camera;
  const Rigid3& cam_from_query =
      joined.other_cameras[static_cast<size_t>(camera - 1)].cam_from_query;
  for (std::optional<Rigid3>* pose :
       {&of_camera.cam_from_world, &of_camera.p3p_cam_from_world, &of_camera.e5p1_cam_from_world}) {
    if (*pose) **pose = cam_from_query * **pose;
  }
  const Matrix6d step = StepAdjoint(cam_from_query);
  for (AlternativePose& alternative : of_camera.alternatives) {
    alternative.cam_from_world = cam_from_query * alternative.cam_from_world;
    if (!alternative.covariance) continue;
    alternative.covariance = (step * *alternative.covariance * step.transpose()).eval();
  }
  if (estimate.covariance) {
    of_camera.covariance = step * *estimate.covariance * step.transpose();
    // A step moves the center by v alone, as in the estimator.
    of_camera.position_sigma = std::sqrt(of_camera.covariance->bottomRightCorner<3, 3>().trace());
  }
  return of_camera;
}

}  // namespace raylift
