#include "estimation/solvers/e5p1.h"

#include <cmath>

#include <Eigen/Geometry>

namespace raylift {
namespace {

// Rays that leave a plane by no more than this do so by rounding.
constexpr double kLeastParallax = 1e-9;

}  // namespace

SolverPose QueryPose(const RelativePose& relative, const Eigen::Vector3d& center, double length) {
  return {relative.rotation, length * relative.direction - relative.rotation * center};
}

std::optional<double> TranslationLength(const RelativePose& relative, const Eigen::Vector3d& center,
                                        const RayPair& sixth, const Eigen::Vector3d& sixth_center) {
  // In the query's frame the sixth reference sits at a + length * direction.
  const Eigen::Vector3d a = relative.rotation * (sixth_center - center);
  const Eigen::Vector3d g = relative.rotation * sixth.reference_ray;
  const Eigen::Vector3d plane_normal = g.cross(sixth.query_ray);
  const double parallax = plane_normal.dot(relative.direction);
  if (!(std::abs(parallax) > kLeastParallax)) return std::nullopt;
  const double length = -plane_normal.dot(a) / parallax;
  if (!(length > 0) || !std::isfinite(length)) {
    return std::nullopt;
  }
  const Eigen::Vector3d baseline = a + length * relative.direction;
  const double along_query = baseline.dot(sixth.query_ray);
  const double along_reference = baseline.dot(g);
  const double cosine = sixth.query_ray.dot(g);
  if (!(along_query - along_reference * cosine > 0) ||
      !(along_query * cosine - along_reference > 0)) {
    return std::nullopt;
  }
  return length;
}

}  // namespace raylift
