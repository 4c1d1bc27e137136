#include "raylift/lifting/auto_filter.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/statistics.h"

#include "raylift/lifting/multi_view_errors.h"

namespace raylift {
namespace {

// A point's error in another reference, by the epipolar line of the point's pixel there.
struct EpipolarError {
  size_t point;
  double along_px;
  double across_px;
  double gain_px;  // by which one unit of log depth moves the projection
};

std::vector<EpipolarError> EpipolarErrors(std::span<const PosedImage> references,
                                          const MultiViewErrors& errors,
                                          std::span<const Match2D3D> points) {
  std::vector<EpipolarError> result;
  for (size_t i = 0; i < points.size(); ++i) {
    if (!points[i].reference) continue;
    const auto own = static_cast<size_t>(*points[i].reference);
    const Eigen::Vector3d ray_in_world =
        points[i].point_in_world - references[own].cam_from_world.OriginInSource();
    for (const ViewError& view : errors.ViewsOf(i)) {
      if (view.own || !view.error_px) continue;
      const PosedImage& other = references[static_cast<size_t>(view.reference)];
      const auto projection =
          other.camera.ImgFromCamWithJacobian(other.cam_from_world * points[i].point_in_world);
      const Eigen::Vector2d motion_px =
          projection->jacobian * (other.cam_from_world.rotation * ray_in_world);
      const double gain_px = motion_px.norm();
      if (!(gain_px > 0)) continue;
      const Eigen::Vector2d line = motion_px / gain_px;
      const Eigen::Vector2d& e = *view.error_px;
      result.push_back({i, e.dot(line), e.y() * line.x() - e.x() * line.y(), gain_px});
    }
  }
  return result;
}

// The standard deviation of errors of which an unknown share is normal around 0 and the others,
// from wrong matches, are anywhere within the range: by expectation maximization.
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

double MedianGain(const std::vector<EpipolarError>& errors) {
  std::vector<double> gains;
  gains.reserve(errors.size());
  for (const EpipolarError& e : errors) gains.push_back(e.gain_px);
  return UpperMedianInPlace(std::span(gains));
}

double OutlierRange(std::span<const PosedImage> references) {
  int width_px = 0;
  for (const PosedImage& reference : references) {
    width_px = std::max(width_px, reference.camera.width_px());
  }
  return 0.5 * width_px;
}

// What the views say of one point's log depth, in units of the deviations.
struct DepthEvidence {
  double precision = 0;
  double weighted_sum = 0;
  size_t num_agreeing = 0;
  size_t num_views = 0;
};

}  // namespace

std::optional<MultiViewTrust> EstimateTrust(std::span<const PosedImage> references,
                                            std::span<const Match2D2D> matches_2d2d,
                                            std::span<const Match2D3D> points) {
  constexpr size_t kFewest = 20;
  constexpr double kGate = 3;  // deviations
  const MultiViewErrors views(references, matches_2d2d, points);
  const std::vector<EpipolarError> all = EpipolarErrors(references, views, points);
  if (all.size() < kFewest) return std::nullopt;
  const double range_px = OutlierRange(references);

  std::vector<double> across;
  across.reserve(all.size());
  for (const EpipolarError& e : all) across.push_back(e.across_px);
  const double keypoints_px = DeviationAmongOutliers(across, range_px);

  std::vector<DepthEvidence> evidence(points.size());
  std::vector<EpipolarError> agreeing;
  for (const EpipolarError& e : all) {
    ++evidence[e.point].num_views;
    if (std::abs(e.across_px) >= kGate * keypoints_px) continue;
    agreeing.push_back(e);
    DepthEvidence& point = evidence[e.point];
    ++point.num_agreeing;
    point.precision += e.gain_px * e.gain_px / (keypoints_px * keypoints_px);
    point.weighted_sum -= e.along_px * e.gain_px / (keypoints_px * keypoints_px);
  }
  if (agreeing.size() < kFewest) return std::nullopt;
  std::vector<double> along;
  along.reserve(agreeing.size());
  for (const EpipolarError& e : agreeing) along.push_back(e.along_px);
  const double along_px = DeviationAmongOutliers(along, range_px);
  const double geometry_px =
      std::sqrt(std::max(along_px * along_px - keypoints_px * keypoints_px, 0.0));

  const double typical_gain_px = MedianGain(agreeing);
  // A hundredth of a pixel, so that perfect geometry has a finite precision.
  const double prior_deviation = std::max(geometry_px, 0.01) / typical_gain_px;
  MultiViewTrust trust{.noise = {keypoints_px, geometry_px, agreeing.size()}, .points = {}};
  for (const DepthEvidence& e : evidence) {
    const double precision = e.precision + 1 / (prior_deviation * prior_deviation);
    const double mean = e.weighted_sum / precision;
    trust.points.push_back(
        {.seen_by_others = e.num_agreeing > 0,
         .in_doubt = e.num_views > 0 && 2 * e.num_agreeing <= e.num_views,
         .expected_error_px = typical_gain_px * std::sqrt(mean * mean + 1 / precision)});
  }
  return trust;
}

std::optional<MultiViewNoise> PooledNoise(std::span<const MultiViewNoise> of_queries) {
  MultiViewNoise pooled;
  double keypoints_px2 = 0, geometry_px2 = 0;
  for (const MultiViewNoise& noise : of_queries) {
    const auto weight = static_cast<double>(noise.num_views);
    keypoints_px2 += weight * noise.keypoints_px * noise.keypoints_px;
    geometry_px2 += weight * noise.geometry_px * noise.geometry_px;
    pooled.num_views += noise.num_views;
  }
  if (pooled.num_views == 0) return std::nullopt;
  const auto total = static_cast<double>(pooled.num_views);
  pooled.keypoints_px = std::sqrt(keypoints_px2 / total);
  pooled.geometry_px = std::sqrt(geometry_px2 / total);
  return pooled;
}

}  // namespace raylift
