#include "raylift/geometry/triangulation.h"

#include <cmath>

#include <Eigen/Geometry>

namespace raylift {

std::optional<ClosestApproach> Approach(const SightLine& a, const SightLine& b) {
  const Eigen::Vector3d normal = a.direction.cross(b.direction);
  const double length2 = normal.squaredNorm();
  if (!(length2 > 0)) return std::nullopt;
  const Eigen::Vector3d b_from_a = b.origin - a.origin;
  const double ray_t_a = b_from_a.cross(b.direction).dot(normal) / length2;
  const double ray_t_b = b_from_a.cross(a.direction).dot(normal) / length2;
  const double sine = std::sqrt(length2 / (a.direction.squaredNorm() * b.direction.squaredNorm()));
  if (!std::isfinite(ray_t_a) || !std::isfinite(ray_t_b) || !std::isfinite(sine)) {
    return std::nullopt;
  }
  return ClosestApproach{ray_t_a, ray_t_b, sine};
}

}  // namespace raylift
