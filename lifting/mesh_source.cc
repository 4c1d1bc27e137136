#include "raylift/lifting/mesh_source.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;

// `ray_in_cam` and `ray_in_world` are the same unit ray.
SurfacePoint MakeSurfacePoint(const Ray& ray_in_world, const Eigen::Vector3d& ray_in_cam,
                              const RayHit& hit) {
  SurfacePoint point;
  point.point_in_world = ray_in_world.origin_in_world + hit.ray_t * ray_in_world.direction_in_world;
  const double along = hit.normal_in_world.dot(ray_in_world.direction_in_world);
  point.back_face = along > 0;
  point.normal_in_world = point.back_face ? -hit.normal_in_world : hit.normal_in_world;
  point.depth_z = hit.ray_t * ray_in_cam.z();
  const double sine = hit.normal_in_world.cross(ray_in_world.direction_in_world).norm();
  point.incidence_deg = std::atan2(sine, std::abs(along)) * kDegPerRad;
  return point;
}

}  // namespace

MeshSource::MeshSource(std::string description, std::shared_ptr<const RayCaster> caster)
    : description_(std::move(description)), caster_(std::move(caster)) {
  RAYLIFT_CHECK(caster_ != nullptr);
}

std::string MeshSource::Description() const { return description_; }

std::vector<std::optional<SurfacePoint>> MeshSource::Lift(
    const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const {
  const Eigen::Vector3d center_in_world = reference.cam_from_world.OriginInSource();
  const Eigen::Quaterniond world_from_cam = reference.cam_from_world.rotation.conjugate();
  std::vector<Ray> rays;
  std::vector<Eigen::Vector3d> rays_in_cam;
  std::vector<size_t> pixel_of_ray;
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (const auto ray_in_cam = reference.camera.RayInCam(pixels[i])) {
      rays.push_back({center_in_world, world_from_cam * *ray_in_cam});
      rays_in_cam.push_back(*ray_in_cam);
      pixel_of_ray.push_back(i);
    }
  }
  const auto hits = caster_->Cast(rays);
  std::vector<std::optional<SurfacePoint>> points(pixels.size());
  for (size_t i = 0; i < hits.size(); ++i) {
    if (hits[i] && hits[i]->ray_t > 0) {
      points[pixel_of_ray[i]] = MakeSurfacePoint(rays[i], rays_in_cam[i], *hits[i]);
    }
  }
  return points;
}

}  // namespace raylift
