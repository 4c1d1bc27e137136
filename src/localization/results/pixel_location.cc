#include "localization/results/pixel_location.h"

#include <array>
#include <cmath>

#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// The least cosine of incidence: a surface that is seen nearly edge-on does not tell where the ray
// meets it.
constexpr double kLeastCosine = 0.02;

// Returns the variance of a point along its ray, by what the query's matches say of lifted points
// and by the surface's own.
double VarianceAlong(const PoseEstimate& estimate, const RayHit& hit, double cosine) {
  double variance = std::pow(hit.sigma / cosine, 2);
  if (const auto& noise = estimate.noise) {
    variance += hit.ray_t * hit.ray_t *
                (noise->depth * noise->depth + noise->common_depth * noise->common_depth +
                 noise->reference_factor * noise->reference_factor);
  }
  return variance;
}

}  // namespace

std::optional<LocatedPixel> LocatePixel(const RayCaster& surface, const PoseEstimate& estimate,
                                        const Camera& camera, const Eigen::Vector2d& pixel) {
  const auto ray_in_cam = camera.RayInCam(pixel);
  if (!ray_in_cam || !estimate.cam_from_world) return std::nullopt;
  const Matrix3d world_from_cam = estimate.cam_from_world->rotation.conjugate().toRotationMatrix();
  const Vector3d center = estimate.cam_from_world->OriginInSource();
  const Vector3d direction = world_from_cam * *ray_in_cam;
  const auto hit = surface.Cast(std::array{Ray{center, direction}}).front();
  if (!hit) return std::nullopt;
  LocatedPixel located{center + hit->ray_t * direction, hit->normal_in_world, std::nullopt};
  if (!estimate.covariance) return located;
  const double toward = hit->normal_in_world.dot(direction);
  const double cosine = std::copysign(std::max(std::abs(toward), kLeastCosine), toward);
  const Matrix3d along_plane =
      Matrix3d::Identity() - direction * hit->normal_in_world.transpose() / cosine;
  // A step (w, v) turns the ray by R' (ray x w) and moves the center by -R' v.
  Eigen::Matrix<double, 3, 6> by_pose;
  by_pose << hit->ray_t * world_from_cam * Skew(*ray_in_cam), -world_from_cam;
  by_pose = along_plane * by_pose;
  located.covariance =
      by_pose * *estimate.covariance * by_pose.transpose() +
      VarianceAlong(estimate, *hit, std::abs(cosine)) * direction * direction.transpose();
  return located;
}

}  // namespace raylift
