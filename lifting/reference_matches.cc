#include "lifting/reference_matches.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

#include <Eigen/Geometry>

#include "raylift/base/error.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

// Returns the matches of each query keypoint by reference. Keypoints are in the order of their
// places in the query, so that every n-th pair is an even sample of the image.
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

double DeviationAmongOutliers(const std::vector<double>& errors_px, double range_px) {
  constexpr int kIterations = 30;
  constexpr double kSmallest = 0.1;  // px, below what any keypoint reaches
  const double outlier_density = 1 / (2 * range_px);
  double deviation = 1;
  double share = 0.7;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    double weights = 0, squares = 0;
    size_t count = 0;
    for (const double e : errors_px) {
      if (!(std::abs(e) < range_px)) continue;
      ++count;
      const double normal = share * std::exp(-0.5 * e * e / (deviation * deviation)) /
                            (deviation * std::sqrt(2 * std::numbers::pi));
      const double weight = normal / (normal + (1 - share) * outlier_density);
      weights += weight;
      squares += weight * e * e;
    }
    if (count == 0 || weights == 0) break;
    share = weights / static_cast<double>(count);
    deviation = std::max(kSmallest, std::sqrt(squares / weights));
  }
  return deviation;
}

std::optional<EpipolarError> SplitByLine(const Eigen::Vector2d& error_px,
                                         const Eigen::Vector2d& motion_px) {
  const double gain_px = motion_px.norm();
  if (!(gain_px > 0)) return std::nullopt;
  const Eigen::Vector2d along = motion_px / gain_px;
  return EpipolarError{.along_px = error_px.dot(along),
                       .across_px = error_px.y() * along.x() - error_px.x() * along.y(),
                       .gain_px = gain_px};
}

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

namespace {

// `of_view` are the matches of one keypoint with one reference.
ViewError ErrorInView(const PosedImage& reference, std::span<const Match2D2D> matches,
                      std::span<const size_t> of_view, const Match2D3D& point) {
  const Match2D2D& first = matches[of_view.front()];
  ViewError view{.reference = first.reference,
                 .own = point.reference == first.reference,
                 .reference_px = first.reference_px,
                 .error_px = std::nullopt};
  const auto projected =
      reference.camera.ImgFromCam(reference.cam_from_world * point.point_in_world);
  if (!projected) return view;
  for (const size_t i : of_view) {
    const Eigen::Vector2d error_px = *projected - matches[i].reference_px;
    if (!view.error_px || error_px.squaredNorm() < view.error_px->squaredNorm()) {
      view.reference_px = matches[i].reference_px;
      view.error_px = error_px;
    }
  }
  return view;
}

}  // namespace

MultiViewErrors::MultiViewErrors(std::span<const PosedImage> references,
                                 std::span<const Match2D2D> matches_2d2d,
                                 std::span<const Match2D3D> points) {
  const KeypointNumbers keypoints = NumberQueryKeypoints(matches_2d2d, points);
  auto groups = GroupByKeypoint(keypoints.of_2d2d, keypoints.count);
  for (std::vector<size_t>& group : groups) {
    std::stable_sort(group.begin(), group.end(), [&](size_t a, size_t b) {
      return matches_2d2d[a].reference < matches_2d2d[b].reference;
    });
  }
  first_view_.push_back(0);
  for (size_t i = 0; i < points.size(); ++i) {
    const std::span group(groups[keypoints.of_2d3d[i]]);
    for (size_t begin = 0, end = 0; begin < group.size(); begin = end) {
      const int reference = matches_2d2d[group[begin]].reference;
      while (end < group.size() && matches_2d2d[group[end]].reference == reference) ++end;
      views_.push_back(ErrorInView(references[static_cast<size_t>(reference)], matches_2d2d,
                                   group.subspan(begin, end - begin), points[i]));
    }
    first_view_.push_back(views_.size());
  }
}

}  // namespace raylift
