// Student's t distribution of keypoints' errors in two dimensions. Detectors place most keypoints
// well and some, of coarse scales for instance, several times worse: a scale mixture of normal
// distributions (Lange, Little and Taylor, JASA 1989).
//
// The distribution is given by its `tail`, the inverse of its degrees of freedom: 0 is normal, 1 is
// Cauchy's. Squared distances are in units of its squared scale. Its density and what it makes of
// an error are the kernels' (kernels/joint_expectation.h).

#pragma once

#include <cmath>
#include <optional>
#include <span>

namespace raylift {

inline constexpr double kAsGoodAsNormal = 1e-3;  // as a tail

// Returns the expected information of an error over the mean precision.
inline double StudentInformation(double tail) { return (1 + 2 * tail) / (1 + 4 * tail); }

// Returns the squared distance within which all but this share of the errors are.
inline double StudentQuantile(double share_beyond, double tail) {
  return tail < kAsGoodAsNormal ? -2 * std::log(share_beyond)
                                : (std::pow(share_beyond, -2 * tail) - 1) / tail;
}

// Returns three times the squared distance within which all but one in a hundred errors are: errors
// beyond are no keypoint's noise, nor what a linearization tells.
inline double StudentFar(double tail) { return 3 * StudentQuantile(0.01, tail); }

// A normal prior of the tail.
struct TailPrior {
  double mean, variance;
};

// The most errors that are used: some hundreds tell the tail as well as all do.
inline constexpr size_t kErrorsOfTail = 300;

// Returns the posterior mean of the tail by the squared errors along one axis, whose scale is
// unknown; all tails between 0 and 1 are as likely before but for the prior.
double EstimateTail(std::span<const double> squared_errors, const std::optional<TailPrior>& prior);

// Sums many logarithms as that of their product: one logarithm is taken for some dozens of factors.

class LogOfProduct {
 public:
  // `factor` is positive and neither it nor its inverse beyond 1e200.
  void Multiply(double factor) {
    product_ *= factor;
    if (product_ > 1e100 || product_ < 1e-100) {
      sum_ += std::log(product_);
      product_ = 1;
    }
  }
  double Sum() const { return sum_ + std::log(product_); }

 private:
  double sum_ = 0;
  double product_ = 1;
};

}  // namespace raylift
