#include "first_positive_root.h"

#include <algorithm>

namespace raylift {
namespace {

struct Roots {
  std::array<double, 10> x;
  int count = 0;
};

double BisectSignChange(const Polynomial& polynomial, double low, double high) {
  const bool low_is_positive = Evaluate(polynomial, low) > 0;
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    if (middle <= low || middle >= high) {
      break;
    }
    ((Evaluate(polynomial, middle) > 0) == low_is_positive ? low : high) = middle;
  }
  return low;
}

// The sign changes in (0, 1], ascending: at most one between neighboring roots of the derivative.
Roots SignChangesInUnitInterval(const Polynomial& polynomial, int degree) {
  Roots roots;
  if (degree == 0) {
    return roots;
  }
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

}  // namespace

double Evaluate(const Polynomial& polynomial, double x) {
  double value = 0;
  for (size_t i = polynomial.size(); i-- > 0;) {
    value = value * x + polynomial[i];
  }
  return value;
}

Polynomial Derivative(const Polynomial& polynomial) {
  Polynomial derivative = {};
  for (size_t i = 1; i < polynomial.size(); ++i) {
    derivative[i - 1] = static_cast<double>(i) * polynomial[i];
  }
  return derivative;
}

Polynomial Product(const Polynomial& a, const Polynomial& b) {
  Polynomial product = {};
  for (size_t i = 0; i < a.size(); ++i) {
    for (size_t j = 0; i + j < product.size(); ++j) {
      product[i + j] += a[i] * b[j];
    }
  }
  return product;
}

double FirstPositiveRoot(const Polynomial& polynomial) {
  int degree = static_cast<int>(polynomial.size()) - 1;
  while (degree > 0 && polynomial[static_cast<size_t>(degree)] == 0) {
    --degree;
  }
  const Roots near = SignChangesInUnitInterval(polynomial, degree);
  if (near.count > 0) {
    return near.x[0];
  }
  // Beyond 1 by x -> 1 / x, which reverses the coefficients and the order.
  Polynomial reversed = {};
  std::reverse_copy(polynomial.begin(), polynomial.begin() + degree + 1, reversed.begin());
  const Roots far = SignChangesInUnitInterval(reversed, degree);
  if (far.count > 0) {
    return 1 / far.x[static_cast<size_t>(far.count - 1)];
  }
  return std::numeric_limits<double>::infinity();
}

}  // namespace raylift
