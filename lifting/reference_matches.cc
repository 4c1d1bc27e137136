#include "lifting/reference_matches.h"

#include <algorithm>
#include <tuple>

#include <Eigen/Geometry>

#include "raylift/lifting/depth_alignment.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

// The matches of each query keypoint by reference; the keypoints in the order of their places in
// the query, so that every n-th pair is a fair sample of what it shows.
std::vector<std::vector<size_t>> GroupByPlace(std::span<const Match2D2D> matches) {
  const KeypointNumbers keypoints = NumberQueryKeypoints(matches, {});
  auto groups = GroupByKeypoint(keypoints.of_2d2d, keypoints.count);
  const auto place = [&](size_t i) {
    return std::tuple(matches[i].query_px.x(), matches[i].query_px.y());
  };
  std::stable_sort(groups.begin(), groups.end(), [&](const auto& a, const auto& b) {
    return place(a.front()) < place(b.front());
  });
  const auto key = [&](size_t i) {
    const Match2D2D& match = matches[i];
    return std::tuple(match.reference, match.reference_px.x(), match.reference_px.y());
  };
  for (std::vector<size_t>& group : groups) {
    std::stable_sort(group.begin(), group.end(),
                     [&](size_t a, size_t b) { return key(a) < key(b); });
  }
  return groups;
}

}  // namespace

std::vector<ReferenceMatch> TransitiveMatches(std::span<const Match2D2D> matches) {
  std::vector<ReferenceMatch> pairs;
  for (const std::vector<size_t>& group : GroupByPlace(matches)) {
    for (size_t i = 0; i < group.size(); ++i) {
      for (size_t k = i + 1; k < group.size(); ++k) {
        const Match2D2D& a = matches[group[i]];
        const Match2D2D& b = matches[group[k]];
        if (a.reference == b.reference) continue;
        pairs.push_back({a.reference, b.reference, a.reference_px, b.reference_px});
      }
    }
  }
  return pairs;
}

std::vector<std::vector<HalfMatch>> HalvesByReference(std::span<const ReferenceMatch> matches,
                                                      size_t num_references) {
  std::vector<std::vector<HalfMatch>> halves(num_references);
  for (const ReferenceMatch& m : matches) {
    halves[static_cast<size_t>(m.reference_a)].push_back({m.a_px, m.reference_b, m.b_px});
    halves[static_cast<size_t>(m.reference_b)].push_back({m.b_px, m.reference_a, m.a_px});
  }
  return halves;
}

std::optional<SightLine> LineInOther(const PosedImage& map, const Eigen::Vector2d& pixel,
                                     const PosedImage& other) {
  const auto ray = map.camera.RayInCam(pixel);
  const double depth = ray ? map.camera.DepthOf(*ray) : 0;
  if (!(depth > 0)) return std::nullopt;
  const Rigid3 other_from_map = other.cam_from_world * map.cam_from_world.Inverse();
  return SightLine{.origin = other_from_map.translation,
                   .direction = other_from_map.rotation * (*ray / depth)};
}

std::optional<TriangulatedDepth> TriangulateDepth(const SightLine& line_in_other,
                                                  const Camera& other_camera,
                                                  const Eigen::Vector2d& other_px) {
  const auto other_ray = other_camera.RayInCam(other_px);
  if (!other_ray) return std::nullopt;
  const auto approach =
      Approach(line_in_other, {.origin = Eigen::Vector3d::Zero(), .direction = *other_ray});
  if (!approach || !(approach->ray_t_a > 0)) return std::nullopt;
  const double z = approach->ray_t_a;
  const auto projection = other_camera.ImgFromCamWithJacobian(line_in_other.At(z));
  if (!projection) return std::nullopt;
  return TriangulatedDepth{.z = z,
                           .projected_px = projection->pixel,
                           .gain_px = (projection->jacobian * line_in_other.direction).norm() * z};
}

}  // namespace raylift
