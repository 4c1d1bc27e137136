// The first place on the positive axis at which a polynomial turns negative.

#pragma once

#include <array>
#include <limits>

namespace raylift {

// Coefficients of 1, x, x^2, ...
using Polynomial = std::array<double, 10>;

double Evaluate(const Polynomial& polynomial, double x);
Polynomial Derivative(const Polynomial& polynomial);
// Terms beyond the highest power that a Polynomial holds must vanish.
Polynomial Product(const Polynomial& a, const Polynomial& b);

// The smallest x > 0 at which the polynomial, positive at 0, stops being positive; infinity where
// it never does. Touching zero from above may count as either.
double FirstPositiveRoot(const Polynomial& polynomial);

}  // namespace raylift
