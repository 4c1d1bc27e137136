#include "estimation/problem/priors.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string_view>

#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// The probability that a prior is wrong, and says nothing.
constexpr double kWrong = 0.05;

// Without a prior, the position is within so many times the furthest reference's distance from the
// references' middle, which counts as one local unit at least.
constexpr double kReach = 3;

// A heading says nothing where the image's right has a smaller horizontal part than this.
constexpr double kLeastHorizontal = 0.2;

// A range says nothing of a pose that sees the surface more edge-on than this cosine.
constexpr double kLeastCosine = 0.02;

// The least standard deviation, local units or radians, as of a prior that is said to be exact.
constexpr double kExact = 1e-6;

// LogRight() returns log((1 - kWrong) d), a right prior's part of the mixture, and LogMixture()
// log((1 - kWrong) d + kWrong), the whole; d is the right prior's density over that of knowing
// nothing.
double LogRight(double log_density) { return std::log(1 - kWrong) + log_density; }
double LogMixture(double log_density) {
  const double a = LogRight(log_density);
  const double b = std::log(kWrong);
  return std::max(a, b) + std::log1p(std::exp(-std::abs(a - b)));
}

double LogDensity(const Vector3d& residual, double log_peak) {
  return log_peak - 0.5 * residual.squaredNorm();
}

Vector3d Direction(const Vector3d& vector, std::string_view prior, std::string_view field) {
  const double length = vector.norm();
  if (!(length > 0) || !std::isfinite(length)) {
    throw InputError(
        fmt::format("{} prior, {}: expected a finite vector that is not zero", prior, field));
  }
  return vector / length;
}

// Returns the standard deviation of an angle in radians.
double AngleSigma(double sigma_deg, std::string_view prior) {
  if (!(sigma_deg >= 0) || !std::isfinite(sigma_deg)) {
    throw InputError(fmt::format("{} prior: expected a standard deviation of at least 0", prior));
  }
  return std::max(sigma_deg * std::numbers::pi / 180, kExact);
}

}  // namespace

NormalizedPriors::NormalizedPriors(const PosePriors& priors, const Vector3d& origin_in_world,
                                   double scale, std::span<const Vector3d> centers) {
  double furthest = 1;
  for (const Vector3d& center : centers) {
    if (center.allFinite()) furthest = std::max(furthest, center.norm());
  }
  if (priors.position) {
    const PositionPrior& prior = *priors.position;
    if (!prior.position.allFinite() || !prior.sigma.allFinite() || prior.sigma.minCoeff() < 0) {
      throw InputError(
          "position prior: expected a finite position and standard deviations of at least 0");
    }
    position_ = {.center = (prior.position - origin_in_world) / scale,
                 .sigma = (prior.sigma / scale).cwiseMax(kExact)};
    const double log_volume = std::log(4 * std::numbers::pi / 3) + 3 * std::log(kReach * furthest);
    position_log_peak_ =
        log_volume - 1.5 * std::log(2 * std::numbers::pi) - position_->sigma.array().log().sum();
  }
  if (priors.gravity) {
    const GravityPrior& prior = *priors.gravity;
    gravity_ = {.down_in_cam = Direction(prior.down_in_cam, "gravity", "down_in_cam"),
                .down_in_local = Direction(prior.down_in_world, "gravity", "down_in_world"),
                .sigma = AngleSigma(prior.sigma_deg, "gravity")};
    // The density is normal about the direction, over the uniform one on the sphere.
    gravity_log_peak_ = std::log(2 / (gravity_->sigma * gravity_->sigma));
  }
  if (priors.heading) {
    const HeadingPrior& prior = *priors.heading;
    const Vector3d down = Direction(prior.down_in_world, "heading", "down_in_world");
    const Vector3d right = Direction(prior.right_in_world, "heading", "right_in_world");
    const Vector3d ahead = Direction(right.cross(down), "heading", "right_in_world across");
    heading_ = {.right_in_cam = Direction(prior.right_in_cam, "heading", "right_in_cam"),
                .right_in_local = down.cross(ahead),
                .ahead_in_local = ahead,
                .sigma = AngleSigma(prior.sigma_deg, "heading")};
    // The density is over the uniform one on the circle.
    heading_log_peak_ = 0.5 * std::log(2 * std::numbers::pi) - std::log(heading_->sigma);
  }
  if (priors.orientation) {
    const OrientationPrior& prior = *priors.orientation;
    if (!(std::abs(prior.cam_from_world.norm() - 1) < 1e-6)) {
      throw InputError("orientation prior: expected a unit quaternion");
    }
    orientation_ = {.cam_from_local = prior.cam_from_world.toRotationMatrix(),
                    .sigma = AngleSigma(prior.sigma_deg, "orientation")};
    // The density is over the uniform one of rotations, whose volume in angles about the axes is 8
    // pi^2.
    orientation_log_peak_ = std::log(8 * std::numbers::pi * std::numbers::pi) -
                            1.5 * std::log(2 * std::numbers::pi) -
                            3 * std::log(orientation_->sigma);
  }
  if (priors.range && priors.range->plane) {
    const RangePrior& prior = *priors.range;
    const double sigma = std::hypot(prior.sigma, prior.plane->sigma);
    if (!(prior.range > 0) || !std::isfinite(prior.range) || !(prior.sigma >= 0) ||
        !std::isfinite(sigma) || !prior.plane->point.allFinite()) {
      throw InputError(
          "range prior: expected a positive range, a standard deviation of at least 0 and a plane");
    }
    range_ = {.point = (prior.plane->point - origin_in_world) / scale,
              .normal = Direction(prior.plane->normal, "range", "normal"),
              .range = prior.range / scale,
              .sigma = std::max(sigma / scale, kExact)};
    // The density is over the uniform one of ranges within reach.
    range_log_peak_ = std::log(kReach * furthest) - 0.5 * std::log(2 * std::numbers::pi) -
                      std::log(range_->sigma);
  }
}

double NormalizedPriors::Term::LogEvidence() const {
  return LogMixture(LogDensity(residual, log_peak));
}

double NormalizedPriors::Term::Probability() const {
  return std::exp(LogRight(LogDensity(residual, log_peak)) - LogEvidence());
}

// Averages over the pose's uncertainty, with which the residual r has the covariance I + J C J'.
double NormalizedPriors::Term::Probability(const Matrix6d& covariance) const {
  const Matrix3d spread = Matrix3d::Identity() + jacobian * covariance * jacobian.transpose();
  const double log_density = log_peak - 0.5 * std::log(spread.determinant()) -
                             0.5 * residual.dot(spread.ldlt().solve(residual));
  return std::exp(LogRight(log_density) - LogMixture(log_density));
}

double NormalizedPriors::Term::Shortfall() const { return LogMixture(log_peak) - LogEvidence(); }

void NormalizedPriors::Term::AddPull(double weight, NormalEquations& equations) const {
  equations.hessian += weight * jacobian.transpose() * jacobian;
  equations.gradient += weight * jacobian.transpose() * residual;
}

std::optional<NormalizedPriors::Term> NormalizedPriors::PositionTerm(
    const CamFromLocal& pose) const {
  if (!position_) return std::nullopt;
  const Vector3d center = -pose.rotation.transpose() * pose.translation;
  Term term{(center - position_->center).cwiseQuotient(position_->sigma), position_log_peak_, {}};
  // A step moves the center by -R' v, whatever w is.
  term.jacobian << Matrix3d::Zero(),
      -(position_->sigma.cwiseInverse().asDiagonal() * pose.rotation.transpose());
  return term;
}

std::optional<NormalizedPriors::Term> NormalizedPriors::GravityTerm(
    const CamFromLocal& pose) const {
  if (!gravity_) return std::nullopt;
  const Vector3d down = pose.rotation * gravity_->down_in_local;
  Term term{(down - gravity_->down_in_cam) / gravity_->sigma, gravity_log_peak_, {}};
  term.jacobian << -Skew(down) / gravity_->sigma, Matrix3d::Zero();
  return term;
}

// The residual is the angle about the vertical from where right was said to be to where it is.
std::optional<NormalizedPriors::Term> NormalizedPriors::HeadingTerm(
    const CamFromLocal& pose) const {
  if (!heading_) return std::nullopt;
  const Vector3d right_in_local = pose.rotation.transpose() * heading_->right_in_cam;
  const double x = right_in_local.dot(heading_->right_in_local),
               y = right_in_local.dot(heading_->ahead_in_local);
  const double horizontal2 = x * x + y * y;
  if (horizontal2 < kLeastHorizontal * kLeastHorizontal) return std::nullopt;
  Term term{Vector3d(std::atan2(y, x) / heading_->sigma, 0, 0), heading_log_peak_,
            Eigen::Matrix<double, 3, 6>::Zero()};
  // A step w turns right in the world by R' (right x w).
  const Vector3d slope_in_local =
      (x * heading_->ahead_in_local - y * heading_->right_in_local) / horizontal2;
  term.jacobian.block<1, 3>(0, 0) =
      (pose.rotation * slope_in_local).transpose() * Skew(heading_->right_in_cam) / heading_->sigma;
  return term;
}

// The residual is twice the vector of the quaternion that is left: 2 sin(angle / 2) about its axis.
std::optional<NormalizedPriors::Term> NormalizedPriors::OrientationTerm(
    const CamFromLocal& pose) const {
  if (!orientation_) return std::nullopt;
  Eigen::Quaterniond off(Matrix3d(pose.rotation * orientation_->cam_from_local.transpose()));
  if (off.w() < 0) off.coeffs() *= -1;
  Term term{2 * off.vec() / orientation_->sigma, orientation_log_peak_, {}};
  term.jacobian << (off.w() * Matrix3d::Identity() - Skew(off.vec())) / orientation_->sigma,
      Matrix3d::Zero();
  return term;
}

// The residual is that of the range r = n . (p - c) / (n . a) to the plane through p with the
// normal n, from the center c along the optical axis a.
std::optional<NormalizedPriors::Term> NormalizedPriors::RangeTerm(const CamFromLocal& pose) const {
  if (!range_) return std::nullopt;
  const Vector3d normal_in_cam = pose.rotation * range_->normal;
  const double cosine = normal_in_cam.z();
  if (std::abs(cosine) < kLeastCosine) return std::nullopt;
  const double range =
      (range_->normal.dot(range_->point) + normal_in_cam.dot(pose.translation)) / cosine;
  Term term{Vector3d((range - range_->range) / range_->sigma, 0, 0), range_log_peak_,
            Eigen::Matrix<double, 3, 6>::Zero()};
  // A step w turns the axis by R' (z x w), a step v moves the center by -R' v.
  term.jacobian.row(0) << -range * normal_in_cam.cross(Vector3d::UnitZ()).transpose(),
      normal_in_cam.transpose();
  term.jacobian.row(0) /= cosine * range_->sigma;
  return term;
}

std::array<std::optional<NormalizedPriors::Term>, 5> NormalizedPriors::Terms(
    const CamFromLocal& pose) const {
  return {PositionTerm(pose), GravityTerm(pose), HeadingTerm(pose), OrientationTerm(pose),
          RangeTerm(pose)};
}

double NormalizedPriors::ProbabilityOfPosition(const CamFromLocal& pose) const {
  const auto term = PositionTerm(pose);
  return term ? term->Probability() : 0;
}

double NormalizedPriors::ProbabilityOfGravity(const CamFromLocal& pose) const {
  const auto term = GravityTerm(pose);
  return term ? term->Probability() : 0;
}

double NormalizedPriors::LogEvidence(const CamFromLocal& pose) const {
  double sum = 0;
  for (const auto& term :
       {PositionTerm(pose), GravityTerm(pose), HeadingTerm(pose), OrientationTerm(pose)}) {
    if (term) sum += term->LogEvidence();
  }
  if (const auto range = RangeTerm(pose)) sum += std::min(range->LogEvidence(), 0.0);
  return sum;
}

double NormalizedPriors::Silence(const CamFromLocal& pose) const {
  double sum = 0;
  if (heading_ && !HeadingTerm(pose)) sum += std::max(0.0, LogMixture(heading_log_peak_));
  if (range_ && !RangeTerm(pose)) sum += std::max(0.0, LogMixture(range_log_peak_));
  return sum;
}

double NormalizedPriors::Cost(const CamFromLocal& pose) const {
  double sum = 0;
  for (const auto& term : Terms(pose)) {
    if (term) sum += term->Shortfall();
  }
  return 2 * kSquaredSigma * (sum + Silence(pose));
}

double NormalizedPriors::WorstCost() const {
  const auto shortfall = [](bool is_known, double log_peak) {
    return is_known ? LogMixture(log_peak) - std::log(kWrong) : 0;
  };
  return 2 * kSquaredSigma *
         (shortfall(position_.has_value(), position_log_peak_) +
          shortfall(gravity_.has_value(), gravity_log_peak_) +
          shortfall(heading_.has_value(), heading_log_peak_) +
          shortfall(orientation_.has_value(), orientation_log_peak_) +
          shortfall(range_.has_value(), range_log_peak_));
}

void NormalizedPriors::AddTo(const CamFromLocal& pose, const Matrix6d& covariance,
                             NormalEquations& equations) const {
  for (const auto& term : Terms(pose)) {
    if (term) term->AddPull(term->Probability(covariance), equations);
  }
}

void NormalizedPriors::AddTo(const CamFromLocal& pose, double weight,
                             NormalEquations& equations) const {
  for (const auto& term : Terms(pose)) {
    if (!term) continue;
    term->AddPull(weight * term->Probability(), equations);
    equations.cost += weight * 2 * term->Shortfall();
  }
  equations.cost += weight * 2 * Silence(pose);
}

}  // namespace raylift
