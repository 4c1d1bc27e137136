// Triangulates two matched keypoints: finds where their rays come closest to each other.
//
// With n = a x b of the directions and d from the origin of a to that of b,
//   ray_t_a = ((d x b) . n) / |n|^2   and   ray_t_b = ((d x a) . n) / |n|^2.
// Where one camera stands ahead of the other the rays are nearly parallel and d is long: the
// formula in dot products then subtracts numbers that are almost equal, and loses twice as many
// digits.

#pragma once

#include <cmath>
#include <optional>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace raylift {

// The points origin + ray_t * direction; the direction may have any length but zero.
struct SightLine {
  Eigen::Vector3d origin;
  Eigen::Vector3d direction;

  Eigen::Vector3d At(double ray_t) const { return origin + ray_t * direction; }
};

// The points of either line that are closest to the other; they lie behind the origin where ray_t
// is negative. The caller decides whether they are good enough for a point.
struct ClosestApproach {
  double ray_t_a;
  double ray_t_b;
  double sine;  // of the angle between the lines
};

// Returns where two lines are closest to each other; nullopt if they are parallel or numbers are
// not finite.
inline std::optional<ClosestApproach> Approach(const SightLine& a, const SightLine& b) {
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
