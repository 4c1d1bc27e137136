#include "mapping/view_planes.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "base/index_sets.h"
#include "base/statistics.h"
#include "lifting/source_view.h"

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr double kMaxJump = 0.05;      // of the depth
constexpr double kLeastCosine = 0.15;  // of the angle from straight ahead: 81 degrees
constexpr int kRowsPerBatch = 32;

constexpr size_t kSampledViews = 32;
constexpr int kSampledPixels = 300;
constexpr size_t kNeighbors = 6;
// Two depths that differ by more are of different surfaces.
constexpr double kSameSurface = 0.2;

double CosineOf(const SurfacePoint& point) {
  return std::cos(point.incidence_deg * std::numbers::pi / 180);
}

bool IsClear(const SurfacePoint& point) {
  return point.depth_z > 0 && CosineOf(point) >= kLeastCosine &&
         point.depth_jump.value_or(0) <= kMaxJump;
}

PixelPlane PlaneOf(const SurfacePoint& point, const PosedImage& view, double relative_noise,
                   double unit) {
  const Eigen::Vector3d normal = view.cam_from_world.rotation * point.normal_in_world;
  const Eigen::Vector3d in_cam = view.cam_from_world * point.point_in_world;
  const double sigma =
      std::hypot(point.point_sigma.value_or(relative_noise * point.depth_z), unit / 2);
  return {normal.cast<float>(), static_cast<float>(normal.dot(in_cam)),
          static_cast<float>(point.depth_z),
          static_cast<float>(CosineOf(point) * unit * unit / (sigma * sigma))};
}

// The indices of the views whose centers are the nearest to that of one.
std::vector<size_t> NearestViews(std::span<const PosedImage> views, size_t to) {
  std::vector<std::pair<double, size_t>> others;
  const Eigen::Vector3d center = views[to].cam_from_world.OriginInSource();
  for (size_t i = 0; i < views.size(); ++i) {
    if (i == to) continue;
    others.emplace_back((views[i].cam_from_world.OriginInSource() - center).norm(), i);
  }
  const size_t count = std::min(kNeighbors, others.size());
  std::partial_sort(others.begin(), others.begin() + static_cast<std::ptrdiff_t>(count),
                    others.end());
  std::vector<size_t> nearest;
  for (size_t i = 0; i < count; ++i) nearest.push_back(others[i].second);
  return nearest;
}

// Values of a view's sampled pixels.
struct ScaleSample {
  std::vector<double> depths, pixel_widths, relative_differences;
};

// Adds how far the points are from the planes that another view shows in their place, as a share of
// their depth there.
void Compare(const GeometrySource& source, const PosedImage& other,
             std::span<const SurfacePoint> points, std::vector<double>& relative_differences) {
  std::vector<Eigen::Vector2d> pixels;
  std::vector<const SurfacePoint*> seen;
  for (const SurfacePoint& point : points) {
    const auto pixel = other.camera.ImgFromCam(other.cam_from_world * point.point_in_world);
    if (!pixel || !other.camera.Contains(*pixel)) continue;
    pixels.push_back(*pixel);
    seen.push_back(&point);
  }
  const auto lifted = source.Lift(other, pixels);
  for (size_t i = 0; i < lifted.size(); ++i) {
    if (!lifted[i] || !IsClear(*lifted[i])) continue;
    const Eigen::Vector3d& point = seen[i]->point_in_world;
    const double depth = other.camera.DepthOf(other.cam_from_world * point);
    if (std::abs(depth / lifted[i]->depth_z - 1) > kSameSurface) continue;
    const double distance = lifted[i]->normal_in_world.dot(point - lifted[i]->point_in_world);
    relative_differences.push_back(std::abs(distance) / depth);
  }
}

ScaleSample SampleView(const GeometrySource& source, std::span<const PosedImage> views,
                       size_t index) {
  const PosedImage& view = views[index];
  ScaleSample sample;
  std::vector<SurfacePoint> points;
  for (const auto& point : source.Lift(view, GridPixels(view.camera, kSampledPixels))) {
    if (!point || !IsClear(*point)) continue;
    points.push_back(*point);
    sample.depths.push_back(point->depth_z);
    sample.pixel_widths.push_back(point->depth_z / view.camera.MeanFocalPx());
  }
  for (const size_t other : NearestViews(views, index)) {
    Compare(source, views[other], points, sample.relative_differences);
  }
  return sample;
}

}  // namespace

ViewPlanes LookForPlanes(const GeometrySource& source, const PosedImage& view,
                         double relative_noise, double unit) {
  const int width = view.camera.width_px(), height = view.camera.height_px();
  ViewPlanes seen{.view = view, .planes = {}};
  seen.planes.resize(static_cast<size_t>(width) * static_cast<size_t>(height));
  std::vector<Eigen::Vector2d> pixels;
  for (int begin = 0; begin < height; begin += kRowsPerBatch) {
    pixels.clear();
    for (int y = begin; y < std::min(height, begin + kRowsPerBatch); ++y) {
      for (int x = 0; x < width; ++x) pixels.emplace_back(x + 0.5, y + 0.5);
    }
    const auto points = source.Lift(view, pixels);
    const size_t first = static_cast<size_t>(begin) * static_cast<size_t>(width);
    for (size_t i = 0; i < points.size(); ++i) {
      if (!points[i] || !IsClear(*points[i])) continue;
      seen.planes[first + i] = PlaneOf(*points[i], view, relative_noise, unit);
      seen.max_depth = std::max(seen.max_depth, points[i]->depth_z);
    }
  }
  return seen;
}

ViewScale MeasureScale(const GeometrySource& source, std::span<const PosedImage> views,
                       int threads) {
  const std::vector<size_t> sampled = EvenlySpaced(views.size(), kSampledViews);
  std::vector<ScaleSample> samples(sampled.size());
  ParallelFor(sampled.size(), threads,
              [&](size_t i) { samples[i] = SampleView(source, views, sampled[i]); });
  ScaleSample all;
  const auto add = [](const std::vector<double>& more, std::vector<double>& values) {
    values.insert(values.end(), more.begin(), more.end());
  };
  for (const ScaleSample& sample : samples) {
    add(sample.depths, all.depths);
    add(sample.pixel_widths, all.pixel_widths);
    add(sample.relative_differences, all.relative_differences);
  }
  ViewScale scale;
  scale.pixel_width = UpperMedianOr(std::move(all.pixel_widths), 0);
  scale.num_comparisons = all.relative_differences.size();
  // The difference of two is more than the noise of one.
  scale.relative_noise =
      kSigmaPerMad * UpperMedianOr(std::move(all.relative_differences), 0) / std::numbers::sqrt2;
  scale.noise = scale.relative_noise * UpperMedianOr(std::move(all.depths), 0);
  return scale;
}

}  // namespace raylift
