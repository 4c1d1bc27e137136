// Finds the domain in which a lens is one-to-one: the first radius at which the distorted radius
// stops growing, and, for tangential and prism terms, a disc by a polar grid of directions.

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "base/constants.h"
#include <Eigen/LU>

#include "raylift/geometry/camera.h"

namespace raylift {
namespace {

// The polar grid on which lenses with tangential or prism terms are examined.
constexpr int kNumDirections = 16;
constexpr int kNumRadii = 40;
constexpr double kMaxGridRadius = 8;  // on the plane z = 1: 83 degrees off the axis

// Coefficients of 1, x, x^2, ...
using Polynomial = std::array<double, 10>;

double Evaluate(const Polynomial& polynomial, double x) {
  double value = 0;
  for (size_t i = polynomial.size(); i-- > 0;) value = value * x + polynomial[i];
  return value;
}

Polynomial Derivative(const Polynomial& polynomial) {
  Polynomial derivative = {};
  for (size_t i = 1; i < polynomial.size(); ++i) {
    derivative[i - 1] = static_cast<double>(i) * polynomial[i];
  }
  return derivative;
}

// Terms beyond the highest power that a Polynomial holds must vanish.
Polynomial Product(const Polynomial& a, const Polynomial& b) {
  Polynomial product = {};
  for (size_t i = 0; i < a.size(); ++i) {
    for (size_t j = 0; i + j < product.size(); ++j) product[i + j] += a[i] * b[j];
  }
  return product;
}

struct Roots {
  std::array<double, 10> x;
  int count = 0;
};

double BisectSignChange(const Polynomial& polynomial, double low, double high) {
  const bool low_is_positive = Evaluate(polynomial, low) > 0;
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    if (middle <= low || middle >= high) break;
    ((Evaluate(polynomial, middle) > 0) == low_is_positive ? low : high) = middle;
  }
  return low;
}

// Returns the sign changes in (0, 1], ascending: at most one between neighboring roots of the
// derivative.
Roots SignChangesInUnitInterval(const Polynomial& polynomial, int degree) {
  Roots roots;
  if (degree == 0) return roots;
  Roots turns = SignChangesInUnitInterval(Derivative(polynomial), degree - 1);
  turns.x[static_cast<size_t>(turns.count++)] = 1;
  double low = 0;
  for (int i = 0; i < turns.count; ++i) {
    const double high = turns.x[static_cast<size_t>(i)];
    if ((Evaluate(polynomial, low) > 0) != (Evaluate(polynomial, high) > 0)) {
      roots.x[static_cast<size_t>(roots.count++)] = BisectSignChange(polynomial, low, high);
    }
    low = high;
  }
  return roots;
}

// Returns the smallest x > 0 at which the polynomial, positive at 0, stops being positive; infinity
// if it never does. Touching zero from above may count as either.
double FirstPositiveRoot(const Polynomial& polynomial) {
  int degree = static_cast<int>(polynomial.size()) - 1;
  while (degree > 0 && polynomial[static_cast<size_t>(degree)] == 0) --degree;
  const Roots near = SignChangesInUnitInterval(polynomial, degree);
  if (near.count > 0) return near.x[0];
  // Beyond 1 by x -> 1 / x, which reverses the coefficients and the order.
  Polynomial reversed = {};
  std::reverse_copy(polynomial.begin(), polynomial.begin() + degree + 1, reversed.begin());
  const Roots far = SignChangesInUnitInterval(reversed, degree);
  if (far.count > 0) return 1 / far.x[static_cast<size_t>(far.count - 1)];
  return kInfinity;
}

template <size_t kCount>
Polynomial ToPolynomial(const std::array<double, kCount>& coefficients) {
  Polynomial polynomial = {1};
  std::copy(coefficients.begin(), coefficients.end(), polynomial.begin() + 1);
  return polynomial;
}

bool IsPositive(const Eigen::Matrix2d& jacobian) {
  return jacobian.determinant() > 0 && jacobian.trace() > 0;
}

// Returns the numerator of d(r s(r^2)) / dr as a polynomial in q = r^2, for s = n / d: n d + 2 q
// (n' d - n d').
Polynomial RadialGrowth(const Polynomial& n, const Polynomial& d) {
  const Polynomial two_q = {0, 2};
  const Polynomial rise = Product(Product(two_q, Derivative(n)), d);
  const Polynomial fall = Product(Product(two_q, n), Derivative(d));
  Polynomial growth = Product(n, d);
  for (size_t i = 0; i < growth.size(); ++i) growth[i] += rise[i] - fall[i];
  return growth;
}

}  // namespace

void Lens::LimitRadialDomain() {
  switch (projection_type_) {
    case ProjectionType::kPerspective:
      break;
    case ProjectionType::kEquidistant:
      max_radius_ = std::numbers::pi;
      break;
    case ProjectionType::kDivision:
      max_radius_ = division_k_ > 0 ? 1 / std::sqrt(division_k_) : kInfinity;
      break;
    case ProjectionType::kUnified:
      // Khomutenko, Garcia, Martinet, "An enhanced unified camera model" (2016): the parameters'
      // ranges, and where the image ends. Other parameters have no image.
      if (!(unified_alpha_ >= 0 && unified_alpha_ <= 1 && unified_beta_ > 0)) {
        max_radius_ = 0;
      } else if (unified_alpha_ > 0.5) {
        max_radius_ = 1 / std::sqrt((2 * unified_alpha_ - 1) * unified_beta_);
      }
      break;
    case ProjectionType::kPanorama:
      break;
  }
  switch (radial_) {
    case Radial::kNone:
      max_distorted_radius_ = max_radius_;
      break;
    case Radial::kFov: {
      const double omega = std::abs(fov_omega_);
      max_radius_ = omega < std::numbers::pi ? kInfinity : 0;
      max_distorted_radius_ = omega < std::numbers::pi ? 0.5 * std::numbers::pi / omega : 0;
      break;
    }
    case Radial::kRational: {
      const Polynomial numerator = ToPolynomial(numerator_);
      const Polynomial denominator = ToPolynomial(denominator_);
      const double fold = std::sqrt(FirstPositiveRoot(RadialGrowth(numerator, denominator)));
      const double pole = std::sqrt(FirstPositiveRoot(denominator));
      max_radius_ = std::min({max_radius_, fold, pole});
      // Where nothing folds, the radius grows without bounds.
      max_distorted_radius_ = max_radius_ < pole && max_radius_ < kInfinity
                                  ? max_radius_ * RationalScale(max_radius_ * max_radius_).value
                                  : kInfinity;
      break;
    }
  }
}

// Finds the largest disc, to one step of a polar grid, on which the Jacobian has a positive
// definite symmetric part: on a convex region such a map is one-to-one.
void Lens::LimitNonRadialDomain() {
  if (non_radial_ == NonRadial::kNone) {
    safe_radius_ = max_radius_;
    return;
  }
  safe_radius_ = GridPoint(0, kNumRadii - 1).norm();
  for (int direction = 0; direction < kNumDirections; ++direction) {
    double good_radius = 0;
    for (int i = 1; i < kNumRadii && good_radius < safe_radius_; ++i) {
      const Eigen::Vector2d projected = GridPoint(direction, i);
      const Eigen::Matrix2d jacobian = Distort(projected).jacobian;
      if (!IsPositive(0.5 * (jacobian + jacobian.transpose()))) {
        safe_radius_ = good_radius;
        break;
      }
      good_radius = projected.norm();
    }
  }
}

Eigen::Vector2d Lens::GridPoint(int direction, int radius) const {
  const double angle = 2 * std::numbers::pi * direction / kNumDirections;
  const double length = std::min(max_radius_, kMaxGridRadius) * radius / kNumRadii;
  return {length * std::cos(angle), length * std::sin(angle)};
}

bool Lens::IsInDomain(const Eigen::Vector2d& projected) const {
  const double squared_radius = projected.squaredNorm();
  if (squared_radius < safe_radius_ * safe_radius_) return true;
  if (non_radial_ == NonRadial::kNone || !(squared_radius < max_radius_ * max_radius_)) {
    return false;
  }
  // Close to the limit the tangential and prism terms decide, differently in every direction: no
  // fold may lie on the way from the safe disc.
  constexpr int kNumSteps = 24;
  const double safe_part = safe_radius_ / std::sqrt(squared_radius);
  for (int i = 1; i <= kNumSteps; ++i) {
    const double part = safe_part + (1 - safe_part) * i / kNumSteps;
    if (!IsPositive(Distort(part * projected).jacobian)) return false;
  }
  return true;
}

// Returns the nearest point of the grid, where tangential or prism terms are so strong that the
// radial solution is no good start.
Eigen::Vector2d Lens::NearestOnGrid(const Eigen::Vector2d& distorted) const {
  Eigen::Vector2d nearest = Eigen::Vector2d::Zero();
  double least_error = distorted.norm();
  for (int direction = 0; direction < kNumDirections; ++direction) {
    for (int i = 1; i < kNumRadii; ++i) {
      const Eigen::Vector2d projected = GridPoint(direction, i);
      const double error = (Distort(projected).distorted - distorted).norm();
      if (error < least_error && IsInDomain(projected)) {
        nearest = projected;
        least_error = error;
      }
    }
  }
  return nearest;
}

}  // namespace raylift
