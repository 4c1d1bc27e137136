#include "estimation/confidence/camera_on_line.h"

#include <cmath>

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

double Square(double x) { return x * x; }

// Returns where a x^2 + 2 b x + c < 0, if that is one bounded interval.
std::optional<InlierRange> WhereNegative(double a, double b, double c, size_t keypoint) {
  const double discriminant = b * b - a * c;
  if (!(a > 0) || !(discriminant > 0)) return std::nullopt;
  const double root = std::sqrt(discriminant);
  return InlierRange{(-b - root) / a, (-b + root) / a, keypoint};
}

// Returns where |n.xy|^2 < n.z^2 + v and n.z > 0 in the middle, with n = m - x k.
std::optional<InlierRange> WhereSeen(const Vector3d& m, const Vector3d& k, double v,
                                     size_t keypoint) {
  const auto dot = [](const Vector3d& p, const Vector3d& q) {
    return p.head<2>().dot(q.head<2>()) - p.z() * q.z();
  };
  const auto interval = WhereNegative(dot(k, k), -dot(m, k), dot(m, m) - v, keypoint);
  const bool in_front = interval && m.z() - 0.5 * (interval->begin + interval->end) * k.z() > 0;
  return in_front ? interval : std::nullopt;
}

}  // namespace

// The squared reprojection error is |n.xy|^2 / (n.z^2 + v), with n = m - x k.
std::optional<InlierRange> CameraOnLine::InlierInterval(const NormalizedMatch2D3D& match) const {
  const CamFromLocal camera = problem_.PoseOfCamera(pose_, match.camera);
  const Vector3d m = match.image_from_ray * (camera.rotation * match.point + camera.translation);
  const Vector3d k = match.image_from_ray * (camera.rotation * direction_);
  return WhereSeen(m, k, match.variance_at_unit_depth, match.keypoint);
}

// The squared Sampson error is (q . (b x r))^2 / (|Gq' (b x r)|^2 + |Gr' (q x b)|^2), with the
// baseline b = b0 - x direction.
std::optional<InlierRange> CameraOnLine::InlierInterval(const NormalizedMatch2D2D& match) const {
  const Matrix3d local_from_cam = pose_.rotation.transpose();
  const Vector3d query_ray = local_from_cam * match.query_ray;
  const Vector3d baseline =
      problem_.centers[static_cast<size_t>(match.reference)] -
      local_from_cam *
          (problem_.camera_centers[static_cast<size_t>(match.camera)] - pose_.translation);
  struct Terms {
    double numerator;
    Vector2d by_query, by_reference;
  };
  const auto at = [&](const Vector3d& b) {
    const Vector3d normal = b.cross(match.reference_ray);
    return Terms{query_ray.dot(normal),
                 match.query_gradient.transpose() * (pose_.rotation * normal),
                 match.reference_gradient.transpose() * query_ray.cross(b)};
  };
  const Terms m = at(baseline), k = at(direction_);
  const auto dot = [](const Terms& p, const Terms& q) {
    return p.numerator * q.numerator - p.by_query.dot(q.by_query) -
           p.by_reference.dot(q.by_reference);
  };
  const auto interval = WhereNegative(dot(k, k), -dot(m, k), dot(m, m), match.keypoint);
  if (!interval) return std::nullopt;
  const Vector3d middle = baseline - 0.5 * (interval->begin + interval->end) * direction_;
  // The rays may meet behind a camera by what a pixel's error moves the angle between them.
  const double cosine = query_ray.dot(match.reference_ray);
  const double slack = match.parallax * middle.norm();
  const double from_query = middle.dot(query_ray - cosine * match.reference_ray);
  const double from_reference = middle.dot(cosine * query_ray - match.reference_ray);
  return from_query + slack > 0 && from_reference + slack > 0 ? interval : std::nullopt;
}

// The squared error of the triangulated point in the other reference is |n.xy|^2 / (n.z^2 + v),
// with n = F^-1 (C + (1 + x / l) z r - C'), F = (Gr', r') of its pixel, and v = |(F^-1 z r).xy|^2
// (parallax / sine)^2, as query and dominant tell z only to the share parallax / sine.
std::optional<InlierRange> CameraOnLine::InlierInterval(const NormalizedMatch2D2D& of_dominant,
                                                        const NormalizedMatch2D2D& of_other) const {
  const auto center_of = [&](const NormalizedMatch2D2D& match) -> const Vector3d& {
    return problem_.centers[static_cast<size_t>(match.reference)];
  };
  const Vector3d query_ray = pose_.rotation.transpose() * of_dominant.query_ray;
  const Vector3d query_center =
      pose_.rotation.transpose() *
      (problem_.camera_centers[static_cast<size_t>(of_dominant.camera)] - pose_.translation);
  const Vector3d baseline = query_center - center_of(of_dominant);
  const Vector3d& ray = of_dominant.reference_ray;
  const Vector3d normal = query_ray.cross(ray);
  const double sine = normal.norm();
  // Nearly parallel rays do not tell the point.
  if (!(sine > 2 * of_dominant.parallax)) return std::nullopt;
  const double z = query_ray.cross(baseline).dot(normal) / (sine * sine);
  if (!(z > 0)) return std::nullopt;
  Matrix3d axes;
  axes << of_other.reference_gradient, of_other.reference_ray;
  const Matrix3d image_from_ray = axes.inverse();
  if (!image_from_ray.allFinite()) return std::nullopt;
  const Vector3d along = image_from_ray * (z * ray);
  const Vector3d m = image_from_ray * (center_of(of_dominant) - center_of(of_other)) + along;
  const Vector3d k = -along / baseline.norm();
  const double variance = along.head<2>().squaredNorm() * Square(of_dominant.parallax / sine);
  return WhereSeen(m, k, variance, of_dominant.keypoint);
}

}  // namespace raylift
