#include "estimation/problem/observations.h"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

namespace raylift {
namespace {

// The lifted point lies on the ray of the pixel that it was lifted from, but for rounding.
constexpr double kOnRayPx = 0.02;

Eigen::Matrix3d ImageFromRay(const Eigen::Vector3d& ray,
                             const Eigen::Matrix<double, 3, 2>& gradient, double threshold_px) {
  Eigen::Matrix3d ray_from_image;
  ray_from_image << gradient / threshold_px, ray;
  return ray_from_image.inverse();
}

bool IsOnRay(const Observation& observation, const Eigen::Vector3d& point) {
  const Eigen::Vector3d n = observation.image_from_ray * (point - observation.center);
  return n.z() > 0 && n.head<2>().norm() < kOnRayPx * n.z();
}

}  // namespace

KeypointEvidence GatherEvidence(const PoseProblem& original, const NormalizedProblem& problem) {
  std::vector<std::vector<int>> pairs(problem.num_keypoints);
  std::vector<std::vector<int>> points(problem.num_keypoints);
  for (int i = 0; i < static_cast<int>(problem.matches_2d2d.size()); ++i) {
    pairs[problem.matches_2d2d[i].keypoint].push_back(i);
  }
  for (int i = 0; i < static_cast<int>(problem.matches_2d3d.size()); ++i) {
    points[problem.matches_2d3d[i].keypoint].push_back(i);
  }
  std::vector<int> observation_of_match(original.matches_2d2d.size(), -1);
  KeypointEvidence evidence;
  evidence.query_area_px2 = QueryAreaPx2(original);
  evidence.num_image_cells *= original.num_cameras();
  evidence.focal_px = original.query_camera.MeanFocalPx();
  evidence.centers = problem.centers;
  evidence.observations.reserve(problem.matches_2d2d.size());
  for (size_t k = 0; k < problem.num_keypoints; ++k) {
    if (pairs[k].empty() && points[k].empty()) continue;
    KeypointObservations parts;
    parts.first_observation = static_cast<int>(evidence.observations.size());
    for (const int i : pairs[k]) {
      const NormalizedMatch2D2D& pair = problem.matches_2d2d[i];
      const auto same = std::find_if(evidence.observations.begin() + parts.first_observation,
                                     evidence.observations.end(), [&](const Observation& other) {
                                       return other.reference == pair.reference &&
                                              other.ray == pair.reference_ray;
                                     });
      if (same != evidence.observations.end()) {  // one match, given twice
        observation_of_match[static_cast<size_t>(pair.match)] =
            static_cast<int>(same - evidence.observations.begin());
        continue;
      }
      observation_of_match[static_cast<size_t>(pair.match)] =
          static_cast<int>(evidence.observations.size());
      evidence.observations.push_back(
          {.image_from_ray = ImageFromRay(pair.reference_ray, pair.reference_gradient,
                                          std::hypot(problem.sampson_threshold_px,
                                                     kSigmasOfThreshold * pair.reference_sigma_px)),
           .center = problem.centers[pair.reference],
           .ray = pair.reference_ray,
           .extra_variance_px2 = pair.reference_sigma_px * pair.reference_sigma_px,
           .log_distance = 0,
           .depth_variance = 0,
           .reference = pair.reference,
           .has_depth = false});
    }
    parts.end_observation = static_cast<int>(evidence.observations.size());
    parts.first_unanchored = static_cast<int>(evidence.unanchored.size());
    // In the order of the matches: of several points on one ray the first is taken.
    std::sort(points[k].begin(), points[k].end(), [&](int a, int b) {
      return problem.matches_2d3d[a].match < problem.matches_2d3d[b].match;
    });
    for (size_t j = 0; j < points[k].size(); ++j) {
      const int i = points[k][j];
      const NormalizedMatch2D3D& point = problem.matches_2d3d[i];
      // A 3D point that several references have is one.
      if (std::any_of(
              points[k].begin(), points[k].begin() + static_cast<std::ptrdiff_t>(j),
              [&](int other) { return problem.matches_2d3d[other].point == point.point; })) {
        continue;
      }
      // The match that it says it was lifted from, or the one of its own place in the lists, or
      // any.
      Observation* owner = nullptr;
      const auto match = static_cast<size_t>(point.match);
      const size_t likely = original.matches_2d3d[match].match_2d2d.value_or(match);
      if (likely < observation_of_match.size() &&
          observation_of_match[likely] >= parts.first_observation) {
        Observation& observation = evidence.observations[observation_of_match[likely]];
        if (IsOnRay(observation, point.point)) owner = &observation;
      }
      for (int n = parts.first_observation; n < parts.end_observation && !owner; ++n) {
        Observation& observation = evidence.observations[n];
        if (IsOnRay(observation, point.point)) owner = &observation;
      }
      if (owner && owner->has_depth) continue;
      if (owner) {
        owner->has_depth = true;
        const double distance = (point.point - owner->center).norm();
        owner->log_distance = std::log(distance);
        owner->depth_variance = point.sigma * point.sigma / (distance * distance);
        continue;
      }
      evidence.unanchored.push_back({point.point, point.sigma * point.sigma});
    }
    parts.end_unanchored = static_cast<int>(evidence.unanchored.size());
    const auto see_in = [&](const auto& match) {
      parts.camera = match.camera;
      parts.camera_center = problem.camera_centers[static_cast<size_t>(match.camera)];
      parts.image_cell = QueryImageCell(original, match, kImageCellsPerSide);
      parts.px_by_log_focal = match.query_px - original.CameraAt(match.camera).principal_point_px();
    };
    if (pairs[k].empty()) {
      see_in(original
                 .matches_2d3d[static_cast<size_t>(problem.matches_2d3d[points[k].front()].match)]);
    } else {
      see_in(
          original.matches_2d2d[static_cast<size_t>(problem.matches_2d2d[pairs[k].front()].match)]);
    }
    if (!pairs[k].empty()) {
      const NormalizedMatch2D2D& pair = problem.matches_2d2d[pairs[k].front()];
      parts.image_from_cam =
          ImageFromRay(pair.query_ray, pair.query_gradient, problem.sampson_threshold_px);
    } else {
      parts.image_from_cam = problem.matches_2d3d[points[k].front()].image_from_ray;
      parts.image_from_cam.topRows<2>() *= problem.reprojection_threshold_px;
    }
    evidence.keypoints.push_back(parts);
  }
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const UnanchoredPoint& point : evidence.unanchored) sum += point.point;
  evidence.centers.push_back(sum / std::max(1.0, static_cast<double>(evidence.unanchored.size())));
  return evidence;
}

}  // namespace raylift
