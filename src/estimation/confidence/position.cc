// Whether the matches tell where the camera is, beside where it looks.

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/statistics.h"
#include "estimation/confidence/confidence.h"

namespace raylift {
namespace {

std::vector<NormalizedMatch2D2D> Inliers2D2D(const NormalizedProblem& problem,
                                             const CamFromLocal& pose) {
  const Residuals residuals = ComputeResiduals(problem, pose, MatchSets::k2D2D);
  std::vector<NormalizedMatch2D2D> inliers;
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    if (residuals.of_2d2d[i] < 1) inliers.push_back(problem.matches_2d2d[i]);
  }
  return inliers;
}

}  // namespace

double ProbabilityOfDistance(const NormalizedProblem& problem, const CamFromLocal& pose,
                             double clustering) {
  // Local units are the references' spread.
  constexpr double kLeastTranslation = 0.25;
  if (problem.centers.empty()) return 1;
  const std::vector<NormalizedMatch2D2D> inliers = Inliers2D2D(problem, pose);
  std::vector<int> counts(problem.num_camera_references(), 0);
  for (const NormalizedMatch2D2D& pair : inliers)
    ++counts[static_cast<size_t>(pair.camera_reference)];
  const auto most =
      static_cast<int>(std::max_element(counts.begin(), counts.end()) - counts.begin());
  const auto explained_by_others = [&](const std::vector<NormalizedMatch2D2D>& pairs) {
    std::vector<bool> explained(problem.num_keypoints, false);
    for (const NormalizedMatch2D2D& pair : pairs) {
      if (pair.camera_reference != most) explained[pair.keypoint] = true;
    }
    return explained;
  };
  const size_t reference = static_cast<size_t>(most) % problem.centers.size();
  const Eigen::Vector3d& from = problem.centers[reference];
  const Eigen::Vector3d& camera_center =
      problem.camera_centers[static_cast<size_t>(problem.CameraOf(most))];
  const Eigen::Vector3d offset =
      pose.rotation.transpose() * (camera_center - pose.translation) - from;
  const std::vector<bool> explained = explained_by_others(inliers);
  double probability = 1;
  for (const double factor : {0.25, 0.5, 2.0, 4.0}) {
    if (std::abs(factor - 1) * offset.norm() < kLeastTranslation) continue;
    CamFromLocal moved = pose;
    moved.translation = camera_center - pose.rotation * (from + factor * offset);
    // Where both explain the same there is nothing to choose by.
    probability = std::min(
        probability, ExclusiveInliers(explained, explained_by_others(Inliers2D2D(problem, moved)))
                         .ProbabilityOfFirst(clustering)
                         .value_or(0.5));
  }
  return probability;
}

double ProbabilityOfPosition(const NormalizedProblem& problem, const CamFromLocal& pose,
                             double position_sigma) {
  if (!(position_sigma > 0)) return 1;
  const Eigen::Vector3d center = -pose.rotation.transpose() * pose.translation;
  const Residuals residuals = ComputeResiduals(problem, pose, MatchSets::k2D3D);
  std::vector<double> distances;
  for (size_t i = 0; i < problem.matches_2d3d.size(); ++i) {
    if (residuals.of_2d3d[i] < 1)
      distances.push_back((problem.matches_2d3d[i].point - center).norm());
  }
  // Local coordinates are centered on the references, their unit is the references' spread.
  const double reach = std::max({1.0, center.norm(), UpperMedianOr(std::move(distances), 0)});
  return std::erf(reach / (position_sigma * std::numbers::sqrt2));
}

}  // namespace raylift
