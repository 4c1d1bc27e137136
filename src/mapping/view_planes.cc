#include "mapping/view_planes.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "base/index_sets.h"
#include "base/statistics.h"
#include "lifting/source_view.h"
#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr double kMaxJump = 0.05;      // of the depth
constexpr double kLeastCosine = 0.15;  // of the angle from straight ahead: 81 degrees
constexpr int kRowsPerBatch = 32;

constexpr size_t kSampledViews = 32;
constexpr int kSampledPixels = 300;
constexpr size_t kNeighbors = 6;
// Depths that differ by more than this share are of different surfaces.
constexpr double kSameSurface = 0.2;

bool IsClear(const SurfacePoint& point) {
  return point.depth_z > 0 && point.depth_jump.value_or(0) <= kMaxJump;
}

// Sets the plane through a point, whose depth has this standard deviation.
void SetPlane(const Eigen::Vector3d& normal, const Eigen::Vector3d& point, double sigma,
              double unit, PixelPlane& plane) {
  const double cosine = -normal.dot(point.normalized());
  plane.normal_in_cam = normal.cast<float>();
  plane.offset = static_cast<float>(normal.dot(point));
  plane.weight = cosine < kLeastCosine
                     ? 0
                     : static_cast<float>(cosine * unit * unit / (sigma * sigma + unit * unit / 4));
}

// Returns the radius in pixels of a window that tells the slopes of a plane to kSlopeNoise: their
// deviation is that of the depth over the root of the sum of the squares of the pixels' distances.
int RadiusOf(const ViewScale& scale, double focal_px) {
  constexpr double kSlopeNoise = 0.15;
  constexpr int kMostRadius = 5;
  const double noise_px = scale.relative_roughness * focal_px;
  int radius = 0;
  for (double sum = 0.5; radius < kMostRadius && noise_px > kSlopeNoise * std::sqrt(sum);) {
    ++radius;
    sum = (2 * radius + 1) * radius * (radius + 1) * (2 * radius + 1) / 3.0;
  }
  return radius;
}

// Fits the inverse depth about a pixel, which is linear on a plane: returns its value there, and
// its slopes.
std::optional<Eigen::Vector3d> FitInverseDepth(std::span<const float> depths, PlaneSize size, int x,
                                               int y, int radius, double same_share) {
  constexpr double kLeastPixels = 6;
  const auto depth_at = [&](int column, int row) {
    return static_cast<double>(depths[static_cast<size_t>(row) * size.width_px + column]);
  };
  const double center = depth_at(x, y);
  double count = 0, x_sum = 0, y_sum = 0, xx = 0, xy = 0, yy = 0;
  Eigen::Vector3d values = Eigen::Vector3d::Zero();
  for (int row = std::max(0, y - radius); row <= std::min(size.height_px - 1, y + radius); ++row) {
    for (int column = std::max(0, x - radius); column <= std::min(size.width_px - 1, x + radius);
         ++column) {
      const double depth = depth_at(column, row);
      if (!(std::abs(depth - center) <= same_share * center)) continue;
      const double dx = column - x, dy = row - y;
      count += 1;
      x_sum += dx;
      y_sum += dy;
      xx += dx * dx;
      xy += dx * dy;
      yy += dy * dy;
      values += Eigen::Vector3d(1, dx, dy) / depth;
    }
  }
  Eigen::Matrix3d squares;
  squares << count, x_sum, y_sum, x_sum, xx, xy, y_sum, xy, yy;
  const Eigen::Vector3d fit = squares.ldlt().solve(values);
  if (count < kLeastPixels || !fit.allFinite() || !(fit[0] > 0)) return std::nullopt;
  return fit;
}

// Puts planes in the place of those of single pixels.
void FitPlanes(int radius, const ViewScale& scale, double unit, ViewPlanes& seen) {
  const Camera& camera = seen.view.camera;
  const PlaneSize size = {camera.width_px(), camera.height_px()};
  std::vector<float> depths;
  depths.reserve(seen.planes.size());
  for (const PixelPlane& plane : seen.planes) depths.push_back(plane.depth);
  const double same_share = std::max(kMaxJump, 4 * scale.relative_roughness);
  const auto point_at = [&](double x, double y, double inverse_depth) {
    const Eigen::Vector3d ray = camera.RayInCam({x, y}).value_or(Eigen::Vector3d::Zero());
    return Eigen::Vector3d(ray / (inverse_depth * camera.DepthOf(ray)));
  };
  for (size_t i = 0; i < seen.planes.size(); ++i) {
    PixelPlane& plane = seen.planes[i];
    if (plane.depth == 0) continue;
    plane.weight = 0;
    const int x = static_cast<int>(i) % size.width_px, y = static_cast<int>(i) / size.width_px;
    const auto fit = FitInverseDepth(depths, size, x, y, radius, same_share);
    if (!fit) continue;
    const double inverse = (*fit)[0];
    const Eigen::Vector3d point = point_at(x + 0.5, y + 0.5, inverse);
    // Half a pixel to the right and half a pixel down.
    const Eigen::Vector3d right = point_at(x + 1, y + 0.5, inverse + (*fit)[1] / 2) - point;
    const Eigen::Vector3d down = point_at(x + 0.5, y + 1, inverse + (*fit)[2] / 2) - point;
    const Eigen::Vector3d normal = down.cross(right).normalized();
    if (!normal.allFinite()) continue;
    plane.depth = static_cast<float>(1 / inverse);
    SetPlane(normal, point, scale.relative_noise / inverse, unit, plane);
  }
}

// Returns the indices of the views whose centers are the nearest to that of one.
std::vector<size_t> NearestViews(std::span<const PosedImage> views, size_t to) {
  std::vector<std::pair<double, size_t>> others;
  const Eigen::Vector3d center = views[to].cam_from_world.OriginInSource();
  for (size_t i = 0; i < views.size(); ++i) {
    if (i == to) continue;
    others.emplace_back((views[i].cam_from_world.OriginInSource() - center).norm(), i);
  }
  return Nearest(std::move(others), kNeighbors);
}

// Values of a view's sampled pixels.
struct ScaleSample {
  std::vector<double> depths, pixel_widths, relative_differences, roughness;
};

// Adds how far the points are from those that another view shows in their place, as a share of
// their depth there.
void Compare(const GeometrySource& source, const PosedImage& other,
             std::span<const SurfacePoint> points, std::vector<double>& relative_differences) {
  std::vector<Eigen::Vector2d> pixels;
  std::vector<double> depths;
  for (const SurfacePoint& point : points) {
    const Eigen::Vector3d in_cam = other.cam_from_world * point.point_in_world;
    const auto pixel = other.camera.ImgFromCam(in_cam);
    if (!pixel || !other.camera.Contains(*pixel)) continue;
    pixels.push_back(*pixel);
    depths.push_back(other.camera.DepthOf(in_cam));
  }
  const auto lifted = source.Lift(other, pixels);
  for (size_t i = 0; i < lifted.size(); ++i) {
    if (!lifted[i] || !IsClear(*lifted[i])) continue;
    const double difference = std::abs(depths[i] / lifted[i]->depth_z - 1);
    if (difference <= kSameSurface) relative_differences.push_back(difference);
  }
}

// Adds by how much the inverse depth of pixels, which show these points, is not that between their
// neighbors, as a share of it: the root of 6 times the noise.
void AddRoughness(const GeometrySource& source, const PosedImage& view,
                  std::span<const Eigen::Vector2d> pixels,
                  std::span<const std::optional<SurfacePoint>> points,
                  std::vector<double>& roughness) {
  const auto lift_beside = [&](double by_px) {
    std::vector<Eigen::Vector2d> moved(pixels.begin(), pixels.end());
    for (Eigen::Vector2d& pixel : moved) pixel.x() += by_px;
    return source.Lift(view, moved);
  };
  const auto lefts = lift_beside(-1), rights = lift_beside(1);
  for (size_t i = 0; i < pixels.size(); ++i) {
    const auto &left = lefts[i], &middle = points[i], &right = rights[i];
    if (!left || !middle || !right || !IsClear(*middle)) continue;
    const double share = middle->depth_z * (1 / left->depth_z + 1 / right->depth_z) - 2;
    roughness.push_back(std::abs(share) / std::sqrt(6.0));
  }
}

ScaleSample SampleView(const GeometrySource& source, std::span<const PosedImage> views,
                       size_t index) {
  const PosedImage& view = views[index];
  ScaleSample sample;
  std::vector<SurfacePoint> points;
  const std::vector<Eigen::Vector2d> pixels = GridPixels(view.camera, kSampledPixels);
  const auto lifted = source.Lift(view, pixels);
  AddRoughness(source, view, pixels, lifted, sample.roughness);
  for (const auto& point : lifted) {
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
                         const ViewScale& scale, double unit) {
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
      const SurfacePoint& point = *points[i];
      PixelPlane& plane = seen.planes[first + i];
      plane.depth = static_cast<float>(point.depth_z);
      const double relative_noise = point.log_depth_sigma.value_or(scale.relative_noise);
      SetPlane(view.cam_from_world.rotation * point.normal_in_world,
               view.cam_from_world * point.point_in_world,
               point.point_sigma.value_or(relative_noise * point.depth_z), unit, plane);
    }
  }
  const int radius = RadiusOf(scale, view.camera.MeanFocalPx());
  if (radius > 0) FitPlanes(radius, scale, unit, seen);
  for (const PixelPlane& plane : seen.planes) {
    if (plane.weight > 0) seen.max_depth = std::max(seen.max_depth, double{plane.depth});
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
    add(sample.roughness, all.roughness);
  }
  ViewScale scale;
  scale.pixel_width = UpperMedianOr(std::move(all.pixel_widths), 0);
  scale.num_comparisons = all.relative_differences.size();
  // The difference of two is more than the noise of one.
  scale.relative_noise =
      kSigmaPerMad * UpperMedianOr(std::move(all.relative_differences), 0) / std::numbers::sqrt2;
  scale.relative_roughness = kSigmaPerMad * UpperMedianOr(std::move(all.roughness), 0);
  scale.noise = scale.relative_noise * UpperMedianOr(std::move(all.depths), 0);
  return scale;
}

}  // namespace raylift
