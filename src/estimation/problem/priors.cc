#include "estimation/problem/priors.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "raylift/base/error.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

// How often a prior says nothing.
constexpr double kWrong = 0.05;

// Where nothing is known, the position is within so many times the furthest reference's distance
// from the references' middle, at least of so many local units.
constexpr double kReach = 3;

// A prior that is said to be exact is exact to so much of a local unit, or radian.
constexpr double kExact = 1e-6;

// The logarithms of the two parts of the mixture, over the density of knowing nothing: of a density
// that a right prior gives, and of a prior that says nothing.
double LogRight(double log_density) { return std::log(1 - kWrong) + log_density; }
double LogMixture(double log_density) {
  const double a = LogRight(log_density);
  const double b = std::log(kWrong);
  return std::max(a, b) + std::log1p(std::exp(-std::abs(a - b)));
}

double LogDensity(const Vector3d& residual, double log_peak) {
  return log_peak - 0.5 * residual.squaredNorm();
}

Vector3d Direction(const Vector3d& vector, const char* field) {
  const double length = vector.norm();
  if (!(length > 0) || !std::isfinite(length)) {
    throw InputError(std::string("gravity prior, ") + field +
                     ": expected a finite vector that is not zero");
  }
  return vector / length;
}

}  // namespace

NormalizedPriors::NormalizedPriors(const PosePriors& priors, const Vector3d& origin_in_world,
                                   double scale, std::span<const Vector3d> centers) {
  if (priors.position) {
    const PositionPrior& prior = *priors.position;
    if (!prior.position.allFinite() || !prior.sigma.allFinite() || prior.sigma.minCoeff() < 0) {
      throw InputError(
          "position prior: expected a finite position and standard deviations of at least 0");
    }
    position_ = {.center = (prior.position - origin_in_world) / scale,
                 .sigma = (prior.sigma / scale).cwiseMax(kExact)};
    double furthest = 1;
    for (const Vector3d& center : centers) {
      if (center.allFinite()) furthest = std::max(furthest, center.norm());
    }
    const double log_volume = std::log(4 * std::numbers::pi / 3) + 3 * std::log(kReach * furthest);
    position_log_peak_ =
        log_volume - 1.5 * std::log(2 * std::numbers::pi) - position_->sigma.array().log().sum();
  }
  if (priors.gravity) {
    const GravityPrior& prior = *priors.gravity;
    if (!(prior.sigma_deg >= 0) || !std::isfinite(prior.sigma_deg)) {
      throw InputError("gravity prior: expected a standard deviation of at least 0");
    }
    gravity_ = {.down_in_cam = Direction(prior.down_in_cam, "down_in_cam"),
                .down_in_local = Direction(prior.down_in_world, "down_in_world"),
                .sigma = std::max(prior.sigma_deg * std::numbers::pi / 180, kExact)};
    // A normal distribution about the direction over a uniform one on the sphere.
    gravity_log_peak_ = std::log(2 / (gravity_->sigma * gravity_->sigma));
  }
}

double NormalizedPriors::Term::LogEvidence() const {
  return LogMixture(LogDensity(residual, log_peak));
}

double NormalizedPriors::Term::Probability() const {
  return std::exp(LogRight(LogDensity(residual, log_peak)) - LogEvidence());
}

double NormalizedPriors::Term::Shortfall() const { return LogMixture(log_peak) - LogEvidence(); }

void NormalizedPriors::Term::AddTo(const Eigen::Matrix<double, 3, 6>& jacobian, double weight,
                                   NormalEquations& equations) const {
  const double right = weight * Probability();
  equations.hessian += right * jacobian.transpose() * jacobian;
  equations.gradient += right * jacobian.transpose() * residual;
  equations.cost += weight * 2 * Shortfall();
}

std::optional<NormalizedPriors::Term> NormalizedPriors::PositionTerm(
    const CamFromLocal& pose) const {
  if (!position_) return std::nullopt;
  const Vector3d center = -pose.rotation.transpose() * pose.translation;
  return Term{(center - position_->center).cwiseQuotient(position_->sigma), position_log_peak_};
}

std::optional<NormalizedPriors::Term> NormalizedPriors::GravityTerm(
    const CamFromLocal& pose) const {
  if (!gravity_) return std::nullopt;
  const Vector3d down = pose.rotation * gravity_->down_in_local;
  return Term{(down - gravity_->down_in_cam) / gravity_->sigma, gravity_log_peak_};
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
  for (const auto& term : {PositionTerm(pose), GravityTerm(pose)}) {
    if (term) sum += term->LogEvidence();
  }
  return sum;
}

double NormalizedPriors::Cost(const CamFromLocal& pose) const {
  double sum = 0;
  for (const auto& term : {PositionTerm(pose), GravityTerm(pose)}) {
    if (term) sum += term->Shortfall();
  }
  return 2 * kSquaredSigma * sum;
}

double NormalizedPriors::WorstCost() const {
  const auto shortfall = [](double log_peak) { return LogMixture(log_peak) - std::log(kWrong); };
  return 2 * kSquaredSigma *
         ((position_ ? shortfall(position_log_peak_) : 0) +
          (gravity_ ? shortfall(gravity_log_peak_) : 0));
}

void NormalizedPriors::AddTo(const CamFromLocal& pose, double weight,
                             NormalEquations& equations) const {
  Eigen::Matrix<double, 3, 6> jacobian;
  if (const auto term = PositionTerm(pose)) {
    // A step moves the center by -R' v, whatever w is.
    jacobian << Eigen::Matrix3d::Zero(),
        -(position_->sigma.cwiseInverse().asDiagonal() * pose.rotation.transpose());
    term->AddTo(jacobian, weight, equations);
  }
  if (const auto term = GravityTerm(pose)) {
    jacobian << -Skew(pose.rotation * gravity_->down_in_local) / gravity_->sigma,
        Eigen::Matrix3d::Zero();
    term->AddTo(jacobian, weight, equations);
  }
}

}  // namespace raylift
