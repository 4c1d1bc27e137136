#include "space_probe.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/statistics.h"

namespace raylift {
namespace {

constexpr int kGridColumns = 24;  // rays through a picture
constexpr int kGridRows = 18;

}  // namespace

std::vector<Eigen::Vector3d> SpreadDirections(int count) {
  const double golden_angle = std::numbers::pi * (3 - std::sqrt(5.0));
  std::vector<Eigen::Vector3d> directions;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - (2 * i + 1.0) / count;
    const double radius = std::sqrt(1 - z * z);
    directions.emplace_back(radius * std::cos(golden_angle * i),
                            radius * std::sin(golden_angle * i), z);
  }
  return directions;
}

Surroundings LookAround(const RayCaster& mesh, const Eigen::Vector3d& center, int directions) {
  const std::vector<Eigen::Vector3d> all = SpreadDirections(directions);
  std::vector<Ray> rays;
  rays.reserve(all.size());
  for (const Eigen::Vector3d& direction : all) rays.push_back({center, direction});
  const auto hits = mesh.Cast(rays);
  Surroundings around{std::numeric_limits<double>::infinity(), 1};
  int seen = 0;
  int front = 0;
  for (size_t i = 0; i < hits.size(); ++i) {
    if (!hits[i]) continue;
    ++seen;
    front += hits[i]->normal_in_world.dot(all[i]) < 0 ? 1 : 0;
    around.clearance = std::min(around.clearance, hits[i]->ray_t);
  }
  if (seen > 0) around.front_share = static_cast<double>(front) / seen;
  return around;
}

Sight LookThrough(const RayCaster& mesh, const Camera& camera, const Rigid3& cam_from_world) {
  const Eigen::Vector3d center = cam_from_world.OriginInSource();
  std::vector<Ray> rays;
  for (int i = 0; i < kGridColumns * kGridRows; ++i) {
    const int column = i % kGridColumns;
    const int row = i / kGridColumns;
    const Eigen::Vector2d pixel((column + 0.5) * camera.width_px() / kGridColumns,
                                (row + 0.5) * camera.height_px() / kGridRows);
    const auto ray = camera.RayInCam(pixel);
    if (ray) rays.push_back({center, cam_from_world.rotation.conjugate() * *ray});
  }
  if (rays.empty()) return {};
  const auto hits = mesh.Cast(rays);
  std::vector<double> ranges;
  int front = 0;
  for (size_t i = 0; i < hits.size(); ++i) {
    if (!hits[i]) continue;
    ranges.push_back(hits[i]->ray_t);
    front += hits[i]->normal_in_world.dot(rays[i].direction_in_world) < 0 ? 1 : 0;
  }
  if (ranges.empty()) return {};
  const auto seen = static_cast<double>(ranges.size());
  return {seen / static_cast<double>(rays.size()), front / seen,
          UpperMedianInPlace(std::span(ranges))};
}

}  // namespace raylift
