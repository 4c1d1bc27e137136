#include "raylift/lifting/mesh_source.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
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

// The rays of one reference's pixels; those without a ray are left out.
class ReferenceRays {
 public:
  ReferenceRays(const PosedImage& reference, double near_z)
      : camera_(reference.camera),
        center_in_world_(reference.cam_from_world.OriginInSource()),
        world_from_cam_(reference.cam_from_world.rotation.conjugate().toRotationMatrix()),
        near_z_(near_z) {}

  // Returns whether there is one.
  bool Add(const Eigen::Vector2d& pixel) {
    const auto ray_in_cam = camera_.RayInCam(pixel);
    if (!ray_in_cam) return false;
    const double ray_t_near = ray_in_cam->z() > 0 ? near_z_ / ray_in_cam->z() : 0;
    rays.push_back({center_in_world_, world_from_cam_ * *ray_in_cam, ray_t_near});
    rays_in_cam.push_back(*ray_in_cam);
    return true;
  }

  void Reserve(size_t count) {
    rays.reserve(count);
    rays_in_cam.reserve(count);
  }

  std::vector<Ray> rays;
  std::vector<Eigen::Vector3d> rays_in_cam;

 private:
  const Camera& camera_;
  Eigen::Vector3d center_in_world_;
  Eigen::Matrix3d world_from_cam_;
  double near_z_;
};

// How far the hit of a neighbouring ray (none: it leaves the scene) is from the point's plane.
double JumpTo(const SurfacePoint& point, const Ray& ray, const std::optional<RayHit>& hit) {
  if (!hit) return std::numeric_limits<double>::infinity();
  const double on_plane = (point.point_in_world - ray.origin_in_world).dot(point.normal_in_world) /
                          ray.direction_in_world.dot(point.normal_in_world);
  // Where the ray runs along the plane or away from it, compare with the point itself.
  const double expected = on_plane > 0 && std::isfinite(on_plane)
                              ? on_plane
                              : (point.point_in_world - ray.origin_in_world).norm();
  return std::abs(hit->ray_t - expected) / std::min(hit->ray_t, expected);
}

// Sets `depth_jump` of the points, pixel by pixel.
void MeasureJumps(const RayCaster& caster, const PosedImage& reference, const MeshOptions& options,
                  std::span<const Eigen::Vector2d> pixels,
                  std::span<std::optional<SurfacePoint>> points) {
  const double r = options.jump_radius_px;
  const std::array<Eigen::Vector2d, 4> offsets = {Eigen::Vector2d(r, 0), Eigen::Vector2d(0, r),
                                                  Eigen::Vector2d(-r, 0), Eigen::Vector2d(0, -r)};
  ReferenceRays neighbors(reference, options.limits.near_z);
  std::vector<size_t> point_of_ray;
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (!points[i]) continue;
    points[i]->depth_jump = 0;
    for (const Eigen::Vector2d& offset : offsets) {
      if (neighbors.Add(pixels[i] + offset)) point_of_ray.push_back(i);
    }
  }
  const auto hits = caster.Cast(neighbors.rays);
  for (size_t k = 0; k < hits.size(); ++k) {
    SurfacePoint& point = *points[point_of_ray[k]];
    point.depth_jump = std::max(*point.depth_jump, JumpTo(point, neighbors.rays[k], hits[k]));
  }
}

}  // namespace

MeshSource::MeshSource(std::string description, std::shared_ptr<const RayCaster> caster,
                       const MeshOptions& options)
    : description_(std::move(description)), caster_(std::move(caster)), options_(options) {
  RAYLIFT_CHECK(caster_ != nullptr);
}

std::string MeshSource::Description() const { return description_; }

std::vector<std::optional<SurfacePoint>> MeshSource::Lift(
    const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const {
  ReferenceRays rays(reference, options_.limits.near_z);
  rays.Reserve(pixels.size());
  std::vector<size_t> pixel_of_ray;
  pixel_of_ray.reserve(pixels.size());
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (rays.Add(pixels[i])) pixel_of_ray.push_back(i);
  }
  const auto hits = caster_->Cast(rays.rays);
  std::vector<std::optional<SurfacePoint>> points(pixels.size());
  for (size_t i = 0; i < hits.size(); ++i) {
    if (hits[i] && hits[i]->ray_t > 0) {
      points[pixel_of_ray[i]] = MakeSurfacePoint(rays.rays[i], rays.rays_in_cam[i], *hits[i]);
    }
  }
  if (std::isfinite(options_.limits.max_depth_jump)) {
    MeasureJumps(*caster_, reference, options_, pixels, points);
  }
  for (auto& point : points) {
    if (point && !options_.limits.Keep(*point)) point.reset();
  }
  return points;
}

}  // namespace raylift
