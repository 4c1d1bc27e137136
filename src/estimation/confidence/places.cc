// Two places that look alike: the alternative explains the photograph as far as its references show
// it, and the best of them does not see what the pose explains. How many references of which place
// were retrieved says nothing then. Not for rigs.

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "estimation/confidence/confidence.h"

#include "raylift/scene/pose_problem.h"

namespace raylift {
namespace {

// The photograph is divided so that a part by chance has no inlier in one case of twenty.
constexpr double kEmptyByChance = 0.05;
constexpr int kMostPartsPerSide = 16;
constexpr int kFewestParts = 4;

// Which part of its photograph a keypoint is in, of `side` x `side`.
size_t PartOf(const Camera& camera, const Eigen::Vector2d& pixel, int side) {
  const auto along = [side](double x, int size) {
    return std::clamp(static_cast<int>(x * side / size), 0, side - 1);
  };
  return static_cast<size_t>(along(pixel.y(), camera.height_px()) * side +
                             along(pixel.x(), camera.width_px()));
}

}  // namespace

std::vector<bool> InlierAssessor::KeypointsBy(const InlierEvidence& evidence,
                                              const std::vector<bool>& references) const {
  std::vector<bool> keypoints(problem_.num_keypoints, false);
  for (size_t i = 0; i < reference_.size(); ++i) {
    if (reference_[i] < 0 || !references[static_cast<size_t>(reference_[i])]) continue;
    if (evidence.inlier[i]) keypoints[KeypointOf(i)] = true;
  }
  return keypoints;
}

bool InlierAssessor::SeesPointsOf(const InlierEvidence& evidence,
                                  const std::vector<bool>& references, const PosedImage& by) const {
  int points = 0, seen = 0;
  for (size_t i = 0; i < problem_.matches_2d3d.size(); ++i) {
    if (!evidence.inlier[i] || reference_[i] < 0) continue;
    if (!references[static_cast<size_t>(reference_[i])]) continue;
    const auto match = static_cast<size_t>(problem_.matches_2d3d[i].match);
    const auto pixel =
        by.camera.ImgFromCam(by.cam_from_world * original_.matches_2d3d[match].point_in_world);
    ++points;
    seen += pixel && by.camera.Contains(*pixel) ? 1 : 0;
  }
  return points == 0 || seen >= kOnePlace * points;
}

bool InlierAssessor::ExplainsAll(const InlierEvidence& place, const std::vector<bool>& references,
                                 const std::vector<bool>& explained,
                                 const std::vector<bool>& others) const {
  const double distance = SceneDistance(problem_, place.pose, sets_) * problem_.scale;
  const Rigid3 world_from_query = problem_.ToWorld(place.pose).Inverse();
  const auto is_shown = [&](size_t keypoint) {
    const Eigen::Vector3d point = world_from_query * (distance * ray_[keypoint]);
    for (size_t r = 0; r < references.size(); ++r) {
      if (!references[r]) continue;
      const PosedImage& reference = original_.references[r];
      const auto pixel = reference.camera.ImgFromCam(reference.cam_from_world * point);
      if (pixel && reference.camera.Contains(*pixel)) return true;
    }
    return false;
  };
  std::vector<size_t> shown;
  for (size_t k = 0; k < others.size(); ++k) {
    if (others[k] && is_shown(k)) shown.push_back(k);
  }
  const auto number = static_cast<double>(shown.size());
  const auto both = static_cast<double>(
      std::count_if(shown.begin(), shown.end(), [&](size_t k) { return explained[k]; }));
  if (both == 0) return false;
  const double enough = std::max(1.0, std::log(kEmptyByChance) / std::log1p(-both / number));
  const int side = std::clamp(static_cast<int>(std::sqrt(number / enough)), 1, kMostPartsPerSide);
  std::vector<int> keypoints(static_cast<size_t>(side * side), 0), of_both = keypoints;
  for (const size_t k : shown) {
    const size_t part = PartOf(original_.query_camera, pixel_[k], side);
    ++keypoints[part];
    of_both[part] += explained[k] ? 1 : 0;
  }
  int parts = 0, empty = 0;
  for (size_t part = 0; part < keypoints.size(); ++part) {
    if (keypoints[part] < enough) continue;
    ++parts;
    empty += of_both[part] == 0 ? 1 : 0;
  }
  return parts >= kFewestParts && empty <= kOnePlace * parts;
}

std::optional<ExclusiveInliers> InlierAssessor::CompareAsPlaces(
    const InlierEvidence& first, const InlierEvidence& second) const {
  if (!Has2D3D(sets_) || !original_.other_cameras.empty()) return std::nullopt;
  std::vector<int> more_of_first(original_.references.size(), 0);
  for (size_t i = 0; i < reference_.size(); ++i) {
    if (reference_[i] < 0) continue;
    more_of_first[static_cast<size_t>(reference_[i])] +=
        (first.inlier[i] ? 1 : 0) - (second.inlier[i] ? 1 : 0);
  }
  const auto most = std::min_element(more_of_first.begin(), more_of_first.end());
  if (most == more_of_first.end() || *most >= 0) return std::nullopt;
  std::vector<bool> of_first, of_second;
  for (const int more : more_of_first) {
    of_first.push_back(more > 0);
    of_second.push_back(more < 0);
  }
  const auto& other = original_.references[static_cast<size_t>(most - more_of_first.begin())];
  if (SeesPointsOf(first, of_first, other)) return std::nullopt;
  const std::vector<bool> by_first = KeypointsBy(first, of_first);
  const std::vector<bool> by_second = KeypointsBy(second, of_second);
  if (!ExplainsAll(second, of_second, by_second, by_first)) return std::nullopt;
  const auto count = [](const std::vector<bool>& keypoints) {
    return static_cast<double>(std::count(keypoints.begin(), keypoints.end(), true));
  };
  ExclusiveInliers exclusive;
  exclusive.only_first = count(by_first);
  exclusive.only_second = count(by_second);
  return exclusive;
}

}  // namespace raylift
