#include "raylift/lifting/depth_source.h"

#include <array>
#include <cmath>
#include <numbers>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;
// Step of the differences that make a normal, in pixels of the map.
constexpr double kStep = 0.5;

Eigen::Vector3d AtDepth(const Camera& camera, const Eigen::Vector3d& ray_in_cam, double depth) {
  return ray_in_cam * (depth / camera.DepthOf(ray_in_cam));
}

// The normal of the surface's local plane in the camera's frame, turned toward it; none where the
// plane is not known.
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

DepthSource::DepthSource(std::string description, std::shared_ptr<const DepthFolder> maps,
                         const DepthSamplingOptions& sampling, const SurfaceLimits& limits)
    : description_(std::move(description)),
      maps_(std::move(maps)),
      sampling_(sampling),
      limits_(limits) {
  RAYLIFT_CHECK(maps_ != nullptr);
}

std::string DepthSource::Description() const { return description_; }

std::vector<std::optional<SurfacePoint>> DepthSource::Lift(
    const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const {
  const auto map = maps_->Load(reference);
  if (map == nullptr) {
    return std::vector<std::optional<SurfacePoint>>(pixels.size());
  }
  auto points = LiftByDepthMap(*map, reference, pixels, sampling_);
  for (auto& point : points) {
    if (point && !limits_.Keep(*point)) point.reset();
  }
  return points;
}

}  // namespace raylift
