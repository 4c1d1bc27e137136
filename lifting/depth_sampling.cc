#include "lifting/depth_sampling.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/constants.h"
#include <Eigen/Geometry>

namespace raylift {
namespace {

// Between this share of `max_jump` and `max_jump` itself, the slope decides.
constexpr double kDoubtfulJump = 0.2;
// A slope leads to the neighbor where it misses it by less than this share of the jump.
constexpr double kMaxSlopeMiss = 0.5;

struct Offset {
  int x, y;
};

class Neighborhood {
 public:
  Neighborhood(const DepthMap& map, int x, int y, double max_jump)
      : map_(map), x_(x), y_(y), max_jump_(max_jump) {}

  // Returns 1/z of a pixel; 0 for a hole, and outside of the map.
  double InverseZ(Offset at) const {
    const int x = x_ + at.x;
    const int y = y_ + at.y;
    if (x < 0 || y < 0 || x >= map_.width_px || y >= map_.height_px) return 0;
    const float z = map_.At(x, y);
    return z > 0 ? 1 / static_cast<double>(z) : 0;
  }

  // Says whether the pixel at `a` and its neighbor, a `step` further, are on one surface.
  bool Linked(Offset a, Offset step) const {
    const double wa = InverseZ(a);
    const double wb = InverseZ({a.x + step.x, a.y + step.y});
    if (wa == 0 || wb == 0) return false;
    const double jump = std::abs(wb - wa);
    const double relative = jump / std::min(wa, wb);
    if (relative > max_jump_) return false;
    if (relative <= kDoubtfulJump * max_jump_) return true;
    const double before = InverseZ({a.x - step.x, a.y - step.y});
    const double after = InverseZ({a.x + 2 * step.x, a.y + 2 * step.y});
    const bool led_to_b = before > 0 && std::abs(2 * wa - before - wb) <= kMaxSlopeMiss * jump;
    const bool led_to_a = after > 0 && std::abs(2 * wb - after - wa) <= kMaxSlopeMiss * jump;
    // Where both sides end after one pixel nothing speaks against a slope.
    return led_to_b || led_to_a || (before == 0 && after == 0);
  }

  // Returns the slope of 1/z along an axis: the pixel's own, else that of a neighbor across the
  // axis on the same surface; nullopt where none is known.
  std::optional<double> Slope(Offset axis) const {
    const Offset across{axis.y, axis.x};
    if (const auto own = SlopeAt({0, 0}, axis)) return own;
    for (const Offset side : {across, Offset{-across.x, -across.y}}) {
      if (!Linked({0, 0}, side)) continue;
      if (const auto slope = SlopeAt(side, axis)) return slope;
    }
    return std::nullopt;
  }

 private:
  // Takes the slope from those of the two neighbors that are on the pixel's surface.
  std::optional<double> SlopeAt(Offset at, Offset axis) const {
    const Offset next{at.x + axis.x, at.y + axis.y};
    const Offset previous{at.x - axis.x, at.y - axis.y};
    const bool has_next = Linked(at, axis);
    const bool has_previous = Linked(at, {-axis.x, -axis.y});
    if (has_next && has_previous) return 0.5 * (InverseZ(next) - InverseZ(previous));
    if (has_next) return InverseZ(next) - InverseZ(at);
    if (has_previous) return InverseZ(at) - InverseZ(previous);
    return std::nullopt;
  }

  const DepthMap& map_;
  int x_, y_;
  double max_jump_;
};

// Returns the 1/z at an offset from the pixel's center, each component within half a pixel.
double Interpolate(const Neighborhood& near, const Eigen::Vector2d& offset,
                   const Eigen::Vector2d& slope) {
  const Offset h{offset.x() < 0 ? -1 : 1, 0};
  const Offset v{0, offset.y() < 0 ? -1 : 1};
  const double fx = std::abs(offset.x());
  const double fy = std::abs(offset.y());
  const double w = near.InverseZ({0, 0});
  const bool has_h = near.Linked({0, 0}, h);
  const bool has_v = near.Linked({0, 0}, v);
  if (has_h && has_v && near.Linked(h, v) && near.Linked(v, h)) {
    return (1 - fy) * ((1 - fx) * w + fx * near.InverseZ(h)) +
           fy * ((1 - fx) * near.InverseZ(v) + fx * near.InverseZ({h.x, v.y}));
  }
  // Toward a neighbor of another surface, the slope on this side of the pixel goes on.
  const double along_x = has_h ? fx * (near.InverseZ(h) - w) : offset.x() * slope.x();
  const double along_y = has_v ? fy * (near.InverseZ(v) - w) : offset.y() * slope.y();
  return w + along_x + along_y;
}

double DepthJump(const Neighborhood& near, const Eigen::Vector2d& slope) {
  const double w = near.InverseZ({0, 0});
  double jump = 0;
  for (int y = -1; y <= 1; ++y) {
    for (int x = -1; x <= 1; ++x) {
      const double other = near.InverseZ({x, y});
      if (other == 0) continue;
      const double expected = w + slope.dot(Eigen::Vector2d(x, y));
      // Where the plane is behind its horizon, compare with the pixel itself.
      const double compared = expected > 0 ? expected : w;
      jump = std::max(jump, std::abs(other - compared) / std::min(other, compared));
    }
  }
  return jump;
}

}  // namespace

std::optional<DepthSample> SampleDepth(const DepthMap& map, const Eigen::Vector2d& position_px,
                                       const DepthSamplingOptions& options) {
  if (!(position_px.x() >= 0 && position_px.x() <= map.width_px && position_px.y() >= 0 &&
        position_px.y() <= map.height_px)) {
    return std::nullopt;
  }
  const int x = std::min(static_cast<int>(position_px.x()), map.width_px - 1);
  const int y = std::min(static_cast<int>(position_px.y()), map.height_px - 1);
  const Neighborhood near(map, x, y, options.max_jump);
  double w = near.InverseZ({0, 0});
  if (w == 0) {
    return std::nullopt;
  }
  const auto slope_x = near.Slope({1, 0});
  const auto slope_y = near.Slope({0, 1});
  const Eigen::Vector2d slope(slope_x.value_or(0), slope_y.value_or(0));
  if (options.interpolation == DepthInterpolation::kEdgeAware) {
    const double between =
        Interpolate(near, position_px - Eigen::Vector2d(x + 0.5, y + 0.5), slope);
    if (between > 0) w = between;
  }
  return DepthSample{.z = 1 / w,
                     .inverse_z_gradient = slope,
                     .has_gradient = slope_x && slope_y,
                     .depth_jump = DepthJump(near, slope)};
}

namespace {

// Step of the differences that make a normal, in pixels of the map.
constexpr double kStep = 0.5;

Eigen::Vector3d AtDepth(const Camera& camera, const Eigen::Vector3d& ray_in_cam, double depth) {
  return ray_in_cam * (depth / camera.DepthOf(ray_in_cam));
}

// Returns the normal of the surface's local plane in the camera's frame, turned toward the camera;
// nullopt where the plane is not known.
std::optional<Eigen::Vector3d> NormalInCam(const Camera& camera, const Eigen::Vector2d& pixel,
                                           const Eigen::Vector2d& image_px_per_map_px,
                                           const DepthSample& sample,
                                           const Eigen::Vector3d& point_in_cam) {
  if (!sample.has_gradient) return std::nullopt;
  std::array<Eigen::Vector3d, 2> tangents;
  for (int axis = 0; axis < 2; ++axis) {
    Eigen::Vector2d moved = pixel;
    moved[axis] += kStep * image_px_per_map_px[axis];
    const auto ray = camera.RayInCam(moved);
    const double w = 1 / sample.z + kStep * sample.inverse_z_gradient[axis];
    if (!ray || camera.DepthOf(*ray) <= 0 || w <= 0) return std::nullopt;
    tangents[static_cast<size_t>(axis)] = AtDepth(camera, *ray, 1 / w) - point_in_cam;
  }
  const Eigen::Vector3d normal = tangents[0].cross(tangents[1]).normalized();
  if (!normal.allFinite()) return std::nullopt;
  return normal.dot(point_in_cam) > 0 ? Eigen::Vector3d(-normal) : normal;
}

}  // namespace

std::vector<std::optional<SurfacePoint>> LiftByDepthMap(const DepthMap& map,
                                                        const PosedImage& reference,
                                                        std::span<const Eigen::Vector2d> pixels,
                                                        const DepthSamplingOptions& options) {
  const Camera& camera = reference.camera;
  const Eigen::Vector2d image_px_per_map_px(
      static_cast<double>(camera.width_px()) / map.width_px,
      static_cast<double>(camera.height_px()) / map.height_px);
  const Rigid3 world_from_cam = reference.cam_from_world.Inverse();
  std::vector<std::optional<SurfacePoint>> points(pixels.size());
  for (size_t i = 0; i < pixels.size(); ++i) {
    const auto ray = camera.RayInCam(pixels[i]);
    if (!ray || camera.DepthOf(*ray) <= 0) continue;
    const Eigen::Vector2d position_px =
        pixels[i].cwiseQuotient(image_px_per_map_px).array() + (0.5 - options.first_sample_px);
    const auto sample = SampleDepth(map, position_px, options);
    if (!sample) continue;
    const Eigen::Vector3d point_in_cam = AtDepth(camera, *ray, sample->z);
    const Eigen::Vector3d normal_in_cam =
        NormalInCam(camera, pixels[i], image_px_per_map_px, *sample, point_in_cam).value_or(-*ray);
    SurfacePoint point;
    point.point_in_world = world_from_cam * point_in_cam;
    point.normal_in_world = world_from_cam.rotation * normal_in_cam;
    point.depth_z = sample->z;
    point.incidence_deg =
        std::atan2(normal_in_cam.cross(*ray).norm(), -normal_in_cam.dot(*ray)) * kDegPerRad;
    point.back_face = false;
    point.depth_jump = sample->depth_jump;
    points[i] = point;
  }
  return points;
}

}  // namespace raylift
