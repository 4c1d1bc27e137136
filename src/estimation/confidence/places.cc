// Compares poses of two places that look alike: the alternative explains the photograph as far as
// its references show it, and the best of them does not see what the pose explains. How many
// references of which place were retrieved says nothing then. Rigs are not compared so.

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "estimation/confidence/confidence.h"
#include "estimation/problem/observations.h"
#include "estimation/problem/repeats.h"

#include "raylift/scene/pose_problem.h"

namespace raylift {
namespace {

// The photograph is divided so that a part by chance has no inlier in one case of twenty.
constexpr double kEmptyByChance = 0.05;
constexpr int kMostPartsPerSide = 16;
constexpr int kFewestParts = 4;

}  // namespace

std::vector<std::optional<size_t>> InlierAssessor::ReferencesOfMatches() const {
  std::vector<std::optional<size_t>> references;
  if (Has2D3D(sets_)) {
    for (const NormalizedMatch2D3D& point : problem_.matches_2d3d) {
      references.push_back(ReferenceOf(original_, static_cast<size_t>(point.match)));
    }
  }
  if (Has2D2D(sets_)) {
    for (const NormalizedMatch2D2D& pair : problem_.matches_2d2d) {
      references.emplace_back(static_cast<size_t>(pair.reference));
    }
  }
  return references;
}

std::vector<bool> InlierAssessor::KeypointsOf(const std::vector<bool>& matches) const {
  std::vector<bool> keypoints(problem_.num_keypoints, false);
  for (size_t i = 0; i < matches.size(); ++i) {
    if (matches[i]) keypoints[KeypointOf(i)] = true;
  }
  return keypoints;
}

bool InlierAssessor::SeesPointsOf(const std::vector<bool>& matches,
                                  const PosedImage& reference) const {
  int points = 0, seen = 0;
  for (size_t i = 0; i < problem_.matches_2d3d.size(); ++i) {
    if (!matches[i]) continue;
    const auto match = static_cast<size_t>(problem_.matches_2d3d[i].match);
    ++points;
    seen += reference.Sees(original_.matches_2d3d[match].point_in_world) ? 1 : 0;
  }
  return points == 0 || seen >= kOnePlace * points;
}

bool InlierAssessor::ExplainsAll(const CamFromLocal& pose,
                                 const std::vector<PosedImage>& references,
                                 const std::vector<bool>& explained,
                                 const std::vector<bool>& others) const {
  const Camera& camera = original_.query_camera;
  const double distance = SceneDistance(problem_, pose, sets_) * problem_.scale;
  const Rigid3 world_from_query = problem_.ToWorld(pose).Inverse();
  std::vector<size_t> shown;
  for (size_t k = 0; k < others.size(); ++k) {
    const auto ray = others[k] ? camera.RayInCam(pixel_[k]) : std::nullopt;
    if (!ray) continue;
    const Eigen::Vector3d point = world_from_query * (distance * *ray);
    const auto sees = [&](const PosedImage& reference) { return reference.Sees(point); };
    if (std::any_of(references.begin(), references.end(), sees)) shown.push_back(k);
  }
  const auto number = static_cast<double>(shown.size());
  const auto both = static_cast<double>(
      std::count_if(shown.begin(), shown.end(), [&](size_t k) { return explained[k]; }));
  if (both == 0) return false;
  const double enough = std::max(1.0, std::log(kEmptyByChance) / std::log1p(-both / number));
  const int side = std::clamp(static_cast<int>(std::sqrt(number / enough)), 1, kMostPartsPerSide);
  std::vector<int> keypoints(static_cast<size_t>(side * side), 0), of_both = keypoints;
  for (const size_t k : shown) {
    const auto part = static_cast<size_t>(ImageCell(camera, pixel_[k], side));
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
  const std::vector<std::optional<size_t>> references = ReferencesOfMatches();
  std::vector<int> more_of_first(original_.references.size(), 0);
  for (size_t i = 0; i < references.size(); ++i) {
    if (!references[i]) continue;
    more_of_first[*references[i]] += (first.inlier[i] ? 1 : 0) - (second.inlier[i] ? 1 : 0);
  }
  const auto most = std::min_element(more_of_first.begin(), more_of_first.end());
  if (most == more_of_first.end() || *most >= 0) return std::nullopt;
  // Each pose has its inliers with the references of which it explains more matches than the other.
  std::vector<bool> of_first(references.size(), false), of_second = of_first;
  for (size_t i = 0; i < references.size(); ++i) {
    const int more = references[i] ? more_of_first[*references[i]] : 0;
    of_first[i] = more > 0 && first.inlier[i];
    of_second[i] = more < 0 && second.inlier[i];
  }
  const auto other = static_cast<size_t>(most - more_of_first.begin());
  if (SeesPointsOf(of_first, original_.references[other])) return std::nullopt;
  std::vector<PosedImage> of_other_place;
  for (size_t r = 0; r < more_of_first.size(); ++r) {
    if (more_of_first[r] < 0) of_other_place.push_back(original_.references[r]);
  }
  const std::vector<bool> by_first = KeypointsOf(of_first), by_second = KeypointsOf(of_second);
  if (!ExplainsAll(second.pose, of_other_place, by_second, by_first)) return std::nullopt;
  const auto count = [](const std::vector<bool>& keypoints) {
    return static_cast<double>(std::count(keypoints.begin(), keypoints.end(), true));
  };
  ExclusiveInliers exclusive;
  exclusive.only_first = count(by_first);
  exclusive.only_second = count(by_second);
  return exclusive;
}

}  // namespace raylift
