#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/constants.h"
#include <Eigen/Geometry>
#include <Eigen/LU>

#include "raylift/geometry/camera.h"

namespace raylift {
namespace {

// The value of 1 + c0 q + c1 q^2 + ..., and its derivative.
struct ValueAndSlope {
  double value;
  double slope;
};
ValueAndSlope OnePlusPolynomial(std::span<const double> coefficients, double q) {
  double value = 0;
  double slope = 0;
  for (size_t i = coefficients.size(); i-- > 0;) {
    slope = slope * q + value;
    value = value * q + coefficients[i];
  }
  return {1 + value * q, value + slope * q};
}

// Returns the count of coefficients without the zeros at the end.
template <size_t kCount>
size_t NumTerms(const std::array<double, kCount>& coefficients) {
  size_t count = kCount;
  while (count > 0 && coefficients[count - 1] == 0) --count;
  return count;
}

}  // namespace

Lens::Lens(CameraModel model, std::span<const double> params) {
  const auto p = [&params](size_t i) { return params[i]; };
  switch (model) {
    case CameraModel::kSimplePinhole:
    case CameraModel::kPinhole:
      break;
    case CameraModel::kSimpleFisheye:
    case CameraModel::kFisheye:
      projection_type_ = ProjectionType::kEquidistant;
      break;
    case CameraModel::kSimpleRadial:
      numerator_ = {p(0)};
      break;
    case CameraModel::kRadial:
      numerator_ = {p(0), p(1)};
      break;
    case CameraModel::kSimpleRadialFisheye:
      projection_type_ = ProjectionType::kEquidistant;
      numerator_ = {p(0)};
      break;
    case CameraModel::kRadialFisheye:
      projection_type_ = ProjectionType::kEquidistant;
      numerator_ = {p(0), p(1)};
      break;
    case CameraModel::kOpenCv:
      numerator_ = {p(0), p(1)};
      tangential_ = {p(2), p(3)};
      break;
    case CameraModel::kOpenCvFisheye:
      projection_type_ = ProjectionType::kEquidistant;
      numerator_ = {p(0), p(1), p(2), p(3)};
      break;
    case CameraModel::kFullOpenCv:
      numerator_ = {p(0), p(1), p(4)};
      denominator_ = {p(5), p(6), p(7)};
      tangential_ = {p(2), p(3)};
      break;
    case CameraModel::kFov:
      fov_omega_ = p(0);
      break;
    case CameraModel::kThinPrismFisheye:
      projection_type_ = ProjectionType::kEquidistant;
      numerator_ = {p(0), p(1), p(4), p(5)};
      tangential_ = {p(2), p(3)};
      prism_x_ = {p(6)};
      prism_y_ = {p(7)};
      break;
    case CameraModel::kRadTanThinPrismFisheye:
      projection_type_ = ProjectionType::kEquidistant;
      numerator_ = {p(0), p(1), p(2), p(3), p(4), p(5)};
      tangential_ = {p(7), p(6)};  // its p0 is OpenCV's p2
      prism_x_ = {p(8), p(9)};
      prism_y_ = {p(10), p(11)};
      non_radial_ = NonRadial::kOfRadial;
      break;
    case CameraModel::kSimpleDivision:
    case CameraModel::kDivision:
      projection_type_ = ProjectionType::kDivision;
      division_k_ = p(0);
      break;
    case CameraModel::kEucm:
      projection_type_ = ProjectionType::kUnified;
      unified_alpha_ = p(0);
      unified_beta_ = p(1);
      break;
    case CameraModel::kEquirectangular:
      projection_type_ = ProjectionType::kPanorama;
      break;
  }
  num_numerator_terms_ = NumTerms(numerator_);
  num_denominator_terms_ = NumTerms(denominator_);
  if (fov_omega_ != 0) {
    radial_ = Radial::kFov;
  } else if (num_numerator_terms_ + num_denominator_terms_ > 0) {
    radial_ = Radial::kRational;
  }
  if (NumTerms(tangential_) + NumTerms(prism_x_) + NumTerms(prism_y_) == 0) {
    non_radial_ = NonRadial::kNone;
  } else if (non_radial_ == NonRadial::kNone) {
    non_radial_ = NonRadial::kOfProjected;
  }
  LimitRadialDomain();
  LimitNonRadialDomain();
}

double Lens::UnifiedRho(const Eigen::Vector3d& point) const {
  return std::hypot(std::sqrt(unified_beta_) * std::hypot(point.x(), point.y()), point.z());
}

std::optional<Eigen::Vector2d> Lens::ApplyProjection(const Eigen::Vector3d& point) const {
  const Eigen::Vector2d xy = point.head<2>();
  const double z = point.z();
  switch (projection_type_) {
    case ProjectionType::kPerspective:
      if (!(z > 0)) return std::nullopt;
      return xy / z;
    case ProjectionType::kEquidistant: {
      const double rho = std::hypot(xy.x(), xy.y());
      if (rho > 0) return std::atan2(rho, z) / rho * xy;
      if (!(z > 0)) return std::nullopt;
      return Eigen::Vector2d::Zero();
    }
    case ProjectionType::kDivision: {
      // u = r (x, y) with k rho^2 r^2 - z r + 1 = 0.
      const double four_k_rho2 = 4 * division_k_ * xy.squaredNorm();
      const double squared_root = z * z - four_k_rho2;
      if (!(squared_root > 0) || (division_k_ > 0 && z < 0)) return std::nullopt;
      const double root = std::sqrt(squared_root);
      const double sum = z > 0 ? z + root : -four_k_rho2 / (root - z);
      if (!(sum > 0)) return std::nullopt;
      return 2 / sum * xy;
    }
    case ProjectionType::kUnified: {
      if (max_radius_ == 0) return std::nullopt;
      const double rho = UnifiedRho(point);
      const double a = std::min(unified_alpha_, 1 - unified_alpha_);
      const double denominator = unified_alpha_ * rho + (1 - unified_alpha_) * z;
      // Beyond, the image folds back.
      if (!((1 - a) * z > -a * rho) || !(denominator > 0)) return std::nullopt;
      return xy / denominator;
    }
    case ProjectionType::kPanorama: {
      const double horizontal = std::hypot(xy.x(), z);
      if (!(horizontal + std::abs(xy.y()) > 0)) return std::nullopt;
      return Eigen::Vector2d(std::atan2(xy.x(), z), std::atan2(xy.y(), horizontal));
    }
  }
  return std::nullopt;
}

Eigen::Matrix<double, 2, 3> Lens::ProjectionJacobian(const Eigen::Vector3d& point,
                                                     const Eigen::Vector2d& projected) const {
  const Eigen::Vector2d xy = point.head<2>();
  const double z = point.z();
  Eigen::Matrix<double, 2, 3> jacobian;
  switch (projection_type_) {
    case ProjectionType::kPerspective:
      jacobian << 1 / z, 0, -projected.x() / z, 0, 1 / z, -projected.y() / z;
      break;
    case ProjectionType::kEquidistant: {
      const double rho = std::hypot(xy.x(), xy.y());
      const double squared_norm = point.squaredNorm();
      const double factor = rho > 0 ? std::atan2(rho, z) / rho : 1 / z;
      const Eigen::Vector2d direction = rho > 0 ? Eigen::Vector2d(xy / rho) : xy;
      jacobian.leftCols<2>() = factor * Eigen::Matrix2d::Identity() +
                               (z / squared_norm - factor) * direction * direction.transpose();
      jacobian.col(2) = -xy / squared_norm;
      break;
    }
    case ProjectionType::kDivision: {
      const double root = std::sqrt(z * z - 4 * division_k_ * xy.squaredNorm());
      // 2 / (z + root), by the coordinate that is not lost in rounding.
      const double factor =
          z > 0 ? 2 / (z + root) : (root - z) / (-2 * division_k_ * xy.squaredNorm());
      jacobian.leftCols<2>() = factor * Eigen::Matrix2d::Identity() +
                               2 * division_k_ / root * projected * projected.transpose();
      jacobian.col(2) = -projected / root;
      break;
    }
    case ProjectionType::kUnified: {
      const double rho = UnifiedRho(point);
      const double denominator = unified_alpha_ * rho + (1 - unified_alpha_) * z;
      jacobian.leftCols<2>() =
          Eigen::Matrix2d::Identity() / denominator -
          unified_alpha_ * unified_beta_ / rho * projected * projected.transpose();
      jacobian.col(2) = -(unified_alpha_ * z / rho + 1 - unified_alpha_) / denominator * projected;
      break;
    }
    case ProjectionType::kPanorama: {
      const double horizontal = std::hypot(xy.x(), z);
      const double squared_norm = point.squaredNorm();
      const double rise = -xy.y() / horizontal / squared_norm;
      jacobian << z / (horizontal * horizontal), 0, -xy.x() / (horizontal * horizontal),
          rise * xy.x(), horizontal / squared_norm, rise * z;
      break;
    }
  }
  return jacobian;
}

Eigen::Vector3d Lens::InvertProjection(const Eigen::Vector2d& projected) const {
  switch (projection_type_) {
    case ProjectionType::kPerspective:
      return projected.homogeneous().normalized();
    case ProjectionType::kEquidistant: {
      const double angle = projected.norm();
      const double sine_over_angle = angle > 0 ? std::sin(angle) / angle : 1;
      return {sine_over_angle * projected.x(), sine_over_angle * projected.y(), std::cos(angle)};
    }
    case ProjectionType::kDivision:
      return Eigen::Vector3d(projected.x(), projected.y(),
                             1 + division_k_ * projected.squaredNorm())
          .normalized();
    case ProjectionType::kUnified: {
      const double squared_radius = projected.squaredNorm();
      const double root = std::sqrt(1 - (2 * unified_alpha_ - 1) * unified_beta_ * squared_radius);
      const double z = (1 - unified_beta_ * unified_alpha_ * unified_alpha_ * squared_radius) /
                       (unified_alpha_ * root + 1 - unified_alpha_);
      return Eigen::Vector3d(projected.x(), projected.y(), z).normalized();
    }
    case ProjectionType::kPanorama: {
      const double cosine = std::cos(projected.y());
      return {cosine * std::sin(projected.x()), std::sin(projected.y()),
              cosine * std::cos(projected.x())};
    }
  }
  return Eigen::Vector3d::UnitZ();
}

Lens::Scale Lens::RationalScale(double squared_radius) const {
  const ValueAndSlope n =
      OnePlusPolynomial({numerator_.data(), num_numerator_terms_}, squared_radius);
  if (num_denominator_terms_ == 0) return {n.value, n.slope};
  const ValueAndSlope d =
      OnePlusPolynomial({denominator_.data(), num_denominator_terms_}, squared_radius);
  const double value = n.value / d.value;
  return {value, (n.slope - value * d.slope) / d.value};
}

// Returns atan(a r) / (omega r) with a = 2 tan(omega / 2).
Lens::Scale Lens::FovScale(double squared_radius) const {
  const double a = 2 * std::tan(0.5 * fov_omega_);
  const double y = a * a * squared_radius;
  // atan(sqrt(y)) / sqrt(y) and its derivative, by the series where the latter would lose digits.
  double value = 1 + y * (-1. / 3 + y * (1. / 5 + y * (-1. / 7 + y * (1. / 9 - y / 11))));
  double slope = -1. / 3 + y * (2. / 5 + y * (-3. / 7 + y * (4. / 9 - y * 5. / 11)));
  if (y > 1e-3) {
    const double x = std::sqrt(y);
    value = std::atan(x) / x;
    slope = 0.5 * (1 / (1 + y) - value) / y;
  }
  return {a / fov_omega_ * value, a / fov_omega_ * a * a * slope};
}

Lens::Distortion Lens::RadialPart(const Eigen::Vector2d& projected) const {
  if (radial_ == Radial::kNone) return {projected, Eigen::Matrix2d::Identity()};
  const double squared_radius = projected.squaredNorm();
  const Scale scale =
      radial_ == Radial::kFov ? FovScale(squared_radius) : RationalScale(squared_radius);
  const Eigen::Matrix2d jacobian = scale.value * Eigen::Matrix2d::Identity() +
                                   2 * scale.slope * projected * projected.transpose();
  return {scale.value * projected, jacobian};
}

Lens::Distortion Lens::NonRadialPart(const Eigen::Vector2d& point) const {
  const double x = point.x();
  const double y = point.y();
  const double q = point.squaredNorm();
  const auto [p1, p2] = tangential_;
  Distortion non_radial;
  non_radial.distorted << 2 * p1 * x * y + p2 * (q + 2 * x * x) +
                              q * (prism_x_[0] + q * prism_x_[1]),
      2 * p2 * x * y + p1 * (q + 2 * y * y) + q * (prism_y_[0] + q * prism_y_[1]);
  const Eigen::Vector2d prism_slope(prism_x_[0] + 2 * q * prism_x_[1],
                                    prism_y_[0] + 2 * q * prism_y_[1]);
  const double cross = 2 * (p1 * x + p2 * y);
  non_radial.jacobian << 2 * p1 * y + 6 * p2 * x, cross, cross, 2 * p2 * x + 6 * p1 * y;
  non_radial.jacobian += 2 * prism_slope * point.transpose();
  return non_radial;
}

Lens::Distortion Lens::Distort(const Eigen::Vector2d& projected) const {
  Distortion distortion = RadialPart(projected);
  switch (non_radial_) {
    case NonRadial::kNone:
      break;
    case NonRadial::kOfProjected: {
      const Distortion non_radial = NonRadialPart(projected);
      distortion.distorted += non_radial.distorted;
      distortion.jacobian += non_radial.jacobian;
      break;
    }
    case NonRadial::kOfRadial: {
      const Distortion non_radial = NonRadialPart(distortion.distorted);
      distortion.distorted += non_radial.distorted;
      distortion.jacobian += (non_radial.jacobian * distortion.jacobian).eval();
      break;
    }
  }
  return distortion;
}

std::optional<Eigen::Vector2d> Lens::Project(const Eigen::Vector3d& point_in_cam) const {
  const auto projected = ApplyProjection(point_in_cam);
  if (!projected || !IsInDomain(*projected)) return std::nullopt;
  const Distortion distortion = Distort(*projected);
  if (!distortion.distorted.allFinite()) return std::nullopt;
  return distortion.distorted;
}

std::optional<Lens::Projection> Lens::ProjectWithJacobian(
    const Eigen::Vector3d& point_in_cam) const {
  const auto projected = ApplyProjection(point_in_cam);
  if (!projected || !IsInDomain(*projected)) return std::nullopt;
  const Distortion distortion = Distort(*projected);
  if (!distortion.distorted.allFinite()) return std::nullopt;
  const Projection projection = {
      distortion.distorted, distortion.jacobian * ProjectionJacobian(point_in_cam, *projected)};
  if (!projection.jacobian.allFinite()) return std::nullopt;
  return projection;
}

std::optional<Eigen::Vector3d> Lens::Unproject(const Eigen::Vector2d& distorted) const {
  if (!distorted.allFinite()) return std::nullopt;
  const auto projected = Undistort(distorted);
  if (!projected || !IsInDomain(*projected)) return std::nullopt;
  if (projection_type_ == ProjectionType::kPanorama) {
    constexpr double kPi = std::numbers::pi * (1 + 1e-12);  // the edge belongs to the image
    if (std::abs(projected->x()) > kPi || std::abs(projected->y()) > 0.5 * kPi) return std::nullopt;
  }
  const Eigen::Vector3d ray = InvertProjection(*projected);
  if (!ray.allFinite()) return std::nullopt;
  return ray;
}

std::optional<Eigen::Vector2d> Lens::Undistort(const Eigen::Vector2d& distorted) const {
  if (radial_ == Radial::kNone && non_radial_ == NonRadial::kNone) return distorted;
  Eigen::Vector2d projected = distorted;
  const double radius = distorted.norm();
  if (radial_ != Radial::kNone && radius > 0) {
    // With tangential or prism terms the radial solution is only a start, so that one beyond the
    // limit will do from inside it.
    const bool inside = radius < max_distorted_radius_;
    if (!inside && non_radial_ == NonRadial::kNone) return std::nullopt;
    projected *= (inside ? UndistortRadius(radius) : 0.99 * max_radius_) / radius;
  }
  if (non_radial_ == NonRadial::kNone) return projected;
  if (auto solution = UndistortByNewton(projected, distorted)) return solution;
  return UndistortByNewton(NearestOnGrid(distorted), distorted);
}

// Finds the radius by Newton's method between bounds: the distorted radius grows with the radius up
// to max_radius_.
double Lens::UndistortRadius(double distorted_radius) const {
  if (radial_ == Radial::kFov) {
    return std::tan(distorted_radius * fov_omega_) / (2 * std::tan(0.5 * fov_omega_));
  }
  double low = 0;
  double high = max_radius_;
  double radius = distorted_radius < high ? distorted_radius : 0.5 * high;
  for (int i = 0; i < 200; ++i) {
    const Scale scale = RationalScale(radius * radius);
    const double excess = radius * scale.value - distorted_radius;
    const double step = excess / (scale.value + 2 * radius * radius * scale.slope);
    (excess > 0 ? high : low) = radius;
    radius -= step;
    // A step this small leaves its square.
    if (std::abs(step) <= 1e-9 * radius || high - low <= 1e-15 * low) break;
    if (!(radius > low && radius < high)) radius = high < kInfinity ? 0.5 * (low + high) : 2 * low;
  }
  return radius;
}

// Steps are halved until they stay in the valid domain and reduce the error.
std::optional<Eigen::Vector2d> Lens::UndistortByNewton(const Eigen::Vector2d& start,
                                                       const Eigen::Vector2d& distorted) const {
  constexpr int kMaxSteps = 100;
  constexpr int kMaxHalvings = 30;
  Eigen::Vector2d projected = start;
  for (int i = 0; i < kMaxHalvings && !IsInDomain(projected); ++i) projected *= 0.5;
  const double scale = 1 + distorted.norm();
  Distortion distortion = Distort(projected);
  double error = (distortion.distorted - distorted).norm();
  bool improves = true;
  for (int i = 0; i < kMaxSteps && improves && error > 1e-15 * scale; ++i) {
    Eigen::Vector2d step = distortion.jacobian.inverse() * (distorted - distortion.distorted);
    improves = false;
    for (int j = 0; j < kMaxHalvings && !improves; ++j, step *= 0.5) {
      const Distortion trial = Distort(projected + step);
      const double trial_error = (trial.distorted - distorted).norm();
      improves = trial_error < error && IsInDomain(projected + step);
      if (improves) {
        projected += step;
        distortion = trial;
        error = trial_error;
      }
    }
  }
  if (!(error <= 1e-11 * scale)) return std::nullopt;
  return projected;
}

}  // namespace raylift
