#include "polygon.h"

#include <numeric>

#include <Eigen/Geometry>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// Cutting ears takes cubic time at worst; a polygon beyond this is no surface that was modeled.
constexpr size_t kMaxCornersForEars = 1000;

double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

// The corners in their plane, counter-clockwise (Newell's normal is their mean orientation).
std::vector<Eigen::Vector2d> ProjectToPlane(std::span<const Eigen::Vector3d> corners) {
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < corners.size(); ++i) {
    normal += (corners[i] - corners[0]).cross(corners[(i + 1) % corners.size()] - corners[0]);
  }
  const Eigen::Vector3d x_axis = normal.unitOrthogonal();
  const Eigen::Vector3d y_axis = normal.normalized().cross(x_axis);
  std::vector<Eigen::Vector2d> flat;
  flat.reserve(corners.size());
  for (const Eigen::Vector3d& corner : corners) {
    const Eigen::Vector3d offset = corner - corners[0];
    flat.emplace_back(offset.dot(x_axis), offset.dot(y_axis));
  }
  return flat;
}

bool IsEar(const std::vector<Eigen::Vector2d>& points, const std::vector<uint32_t>& left,
           size_t tip) {
  const size_t n = left.size();
  const Eigen::Vector2d& a = points[left[(tip + n - 1) % n]];
  const Eigen::Vector2d& b = points[left[tip]];
  const Eigen::Vector2d& c = points[left[(tip + 1) % n]];
  if (Cross(b - a, c - b) <= 0) {
    return false;
  }
  for (const uint32_t index : left) {
    const Eigen::Vector2d& p = points[index];
    if (p == a || p == b || p == c) {
      continue;
    }
    if (Cross(b - a, p - a) >= 0 && Cross(c - b, p - b) >= 0 && Cross(a - c, p - c) >= 0) {
      return false;
    }
  }
  return true;
}

}  // namespace

std::vector<std::array<uint32_t, 3>> TriangulatePolygon(std::span<const Eigen::Vector3d> corners) {
  RAYLIFT_CHECK(corners.size() >= 3);
  std::vector<std::array<uint32_t, 3>> triangles;
  triangles.reserve(corners.size() - 2);
  std::vector<uint32_t> left(corners.size());
  std::iota(left.begin(), left.end(), 0u);
  if (corners.size() > 3 && corners.size() <= kMaxCornersForEars) {
    const std::vector<Eigen::Vector2d> points = ProjectToPlane(corners);
    bool found = true;
    while (left.size() > 3 && found) {
      found = false;
      for (size_t tip = 1; tip <= left.size() && !found; ++tip) {
        const size_t n = left.size();
        if (IsEar(points, left, tip % n)) {
          triangles.push_back({left[(tip + n - 1) % n], left[tip % n], left[(tip + 1) % n]});
          left.erase(left.begin() + static_cast<std::ptrdiff_t>(tip % n));
          found = true;
        }
      }
    }
  }
  for (size_t i = 1; i + 1 < left.size(); ++i) {
    triangles.push_back({left[0], left[i], left[i + 1]});
  }
  return triangles;
}

}  // namespace raylift
