// Triangulates polygons by cutting ears.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "surfaces/raw_mesh.h"
#include <Eigen/Geometry>

#include "raylift/base/error.h"

namespace raylift {
namespace {

double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

// Returns the corners in the plane of the first `outer` ones, which are counter-clockwise there
// (Newell's normal is their mean orientation).
std::vector<Eigen::Vector2d> ProjectToPlane(std::span<const Eigen::Vector3d> corners,
                                            size_t outer) {
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < outer; ++i) {
    normal += (corners[i] - corners[0]).cross(corners[(i + 1) % outer] - corners[0]);
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

// States if other corners may touch an ear: where cuts to holes lie in line, none may be clear of
// all others.
enum class Touching { kRefused, kAllowed };

// Returns how far rounding may move twice the area of a triangle of these corners.
double AreaNoise(std::span<const Eigen::Vector3d> corners) {
  double magnitude = 0, extent = 0;
  for (const Eigen::Vector3d& corner : corners) {
    magnitude = std::max(magnitude, corner.cwiseAbs().maxCoeff());
    extent = std::max(extent, (corner - corners[0]).cwiseAbs().maxCoeff());
  }
  return 16 * std::numeric_limits<double>::epsilon() * magnitude * extent;
}

bool IsEar(const std::vector<Eigen::Vector2d>& points, const std::vector<uint32_t>& left,
           size_t tip, Touching touching, double noise) {
  const size_t n = left.size();
  const Eigen::Vector2d& a = points[left[(tip + n - 1) % n]];
  const Eigen::Vector2d& b = points[left[tip]];
  const Eigen::Vector2d& c = points[left[(tip + 1) % n]];
  const bool is_loose = touching == Touching::kAllowed;
  const double bend = Cross(b - a, c - b);
  if (is_loose ? bend < -noise : bend <= 0) return false;
  return std::none_of(left.begin(), left.end(), [&](uint32_t index) {
    const Eigen::Vector2d& p = points[index];
    if (p == a || p == b || p == c) return false;
    const double inside = std::min({Cross(b - a, p - a), Cross(c - b, p - b), Cross(a - c, p - c)});
    return inside > (is_loose ? noise : -noise);
  });
}

// Returns whether the way from corner `at` of a counter-clockwise ring to p begins inside.
bool BeginsInside(const std::vector<Eigen::Vector2d>& points, const std::vector<uint32_t>& ring,
                  size_t at, const Eigen::Vector2d& p) {
  const size_t n = ring.size();
  const Eigen::Vector2d& corner = points[ring[at]];
  const Eigen::Vector2d in = corner - points[ring[(at + n - 1) % n]];
  const Eigen::Vector2d out = points[ring[(at + 1) % n]] - corner;
  const bool left_of_in = Cross(in, p - corner) >= 0, left_of_out = Cross(out, p - corner) >= 0;
  return Cross(in, out) >= 0 ? left_of_in && left_of_out : left_of_in || left_of_out;
}

// Returns the place in the ring of a corner that a point inside it sees (Eberly 2002): on the way
// to the right, or where the way to that one is blocked, the corner that blocks it.
std::optional<size_t> VisibleCorner(const std::vector<Eigen::Vector2d>& points,
                                    const std::vector<uint32_t>& ring, const Eigen::Vector2d& p) {
  std::optional<size_t> found;
  double nearest = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < ring.size(); ++i) {
    const size_t next = (i + 1) % ring.size();
    const Eigen::Vector2d& a = points[ring[i]];
    const Eigen::Vector2d& b = points[ring[next]];
    if (!(a.y() <= p.y() && p.y() <= b.y()) || a.y() == b.y()) continue;
    const double x = a.x() + (p.y() - a.y()) / (b.y() - a.y()) * (b.x() - a.x());
    if (x < p.x() || x >= nearest) continue;
    nearest = x;
    found = p.y() == a.y() ? i : p.y() == b.y() ? next : a.x() > b.x() ? i : next;
  }
  if (!found) return std::nullopt;
  const Eigen::Vector2d hit(nearest, p.y()), end = points[ring[*found]];
  const double side = Cross(hit - p, end - p);
  double flattest = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < ring.size(); ++i) {
    const Eigen::Vector2d& c = points[ring[i]];
    const bool is_between = (Cross(hit - p, c - p)) * side >= 0 &&
                            Cross(end - hit, c - hit) * side >= 0 &&
                            Cross(p - end, c - end) * side >= 0;
    if (!is_between || c.x() <= p.x() || !BeginsInside(points, ring, i, p)) continue;
    const double slope = std::abs(c.y() - p.y()) / (c.x() - p.x());
    const bool is_better =
        slope < flattest || (slope == flattest && c.x() < points[ring[*found]].x());
    if (!is_better) continue;
    flattest = slope;
    found = i;
  }
  return found;
}

// Joins each hole to the ring by a way there and back, those on the right first; leaves out holes
// that do not lie inside.
void JoinHoles(const std::vector<Eigen::Vector2d>& points, std::span<const uint32_t> begins,
               std::vector<uint32_t>& ring) {
  std::vector<std::vector<uint32_t>> holes;
  for (size_t k = 0; k < begins.size(); ++k) {
    const size_t end = k + 1 < begins.size() ? begins[k + 1] : points.size();
    std::vector<uint32_t> hole(end - begins[k]);
    std::iota(hole.begin(), hole.end(), begins[k]);
    double area = 0;
    for (size_t i = 0; i < hole.size(); ++i) {
      area += Cross(points[hole[i]], points[hole[(i + 1) % hole.size()]]);
    }
    if (area > 0) std::reverse(hole.begin(), hole.end());
    const auto rightmost = std::max_element(hole.begin(), hole.end(), [&](uint32_t a, uint32_t b) {
      return points[a].x() < points[b].x();
    });
    std::rotate(hole.begin(), rightmost, hole.end());
    holes.push_back(std::move(hole));
  }
  std::stable_sort(holes.begin(), holes.end(), [&](const auto& a, const auto& b) {
    return points[a.front()].x() > points[b.front()].x();
  });
  for (std::vector<uint32_t>& hole : holes) {
    const auto corner = VisibleCorner(points, ring, points[hole.front()]);
    if (!corner) continue;
    hole.push_back(hole.front());
    hole.push_back(ring[*corner]);
    ring.insert(ring.begin() + static_cast<std::ptrdiff_t>(*corner) + 1, hole.begin(), hole.end());
  }
}

}  // namespace

std::vector<std::array<uint32_t, 3>> TriangulatePolygon(std::span<const Eigen::Vector3d> corners,
                                                        std::span<const uint32_t> hole_begins) {
  const size_t outer = hole_begins.empty() ? corners.size() : hole_begins.front();
  RAYLIFT_CHECK(outer >= 3);
  std::vector<std::array<uint32_t, 3>> triangles;
  triangles.reserve(corners.size() + 2 * hole_begins.size());
  std::vector<uint32_t> left(outer);
  std::iota(left.begin(), left.end(), 0u);
  if (corners.size() > 3 && corners.size() <= kMaxPolygonCorners) {
    const std::vector<Eigen::Vector2d> points = ProjectToPlane(corners, outer);
    JoinHoles(points, hole_begins, left);
    const double noise = AreaNoise(corners);
    auto touching = Touching::kRefused;
    while (left.size() > 3) {
      const size_t n = left.size();
      size_t tip = 1;
      while (tip <= n && !IsEar(points, left, tip % n, touching, noise)) ++tip;
      if (tip > n) {
        if (touching == Touching::kAllowed) break;
        touching = Touching::kAllowed;
        continue;
      }
      touching = Touching::kRefused;
      triangles.push_back({left[(tip + n - 1) % n], left[tip % n], left[(tip + 1) % n]});
      left.erase(left.begin() + static_cast<std::ptrdiff_t>(tip % n));
    }
  }
  for (size_t i = 1; i + 1 < left.size(); ++i) {
    triangles.push_back({left[0], left[i], left[i + 1]});
  }
  return triangles;
}

}  // namespace raylift
