// The likelihood of an error of which several explanations are possible, each normally distributed
// or, without information, anywhere.

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "sequences/chain.h"
#include <Eigen/LU>

namespace raylift {

// The inverse of a covariance, and the logarithm of its determinant.
struct Information {
  explicit Information(const Matrix6d& inverse_covariance)
      : matrix(inverse_covariance), log_determinant(std::log(inverse_covariance.determinant())) {}

  // Of a covariance that is larger by a factor.
  Information Over(double factor) const {
    Information less = *this;
    less.matrix /= factor;
    less.log_determinant -= 6 * std::log(factor);
    return less;
  }

  Matrix6d matrix;
  double log_determinant;
};

class Mixture {
 public:
  static constexpr size_t kMostParts = 3;

  void Add(double weight, const Information& information) {
    parts_[count_++] = {std::log(weight) + 0.5 * information.log_determinant, information.matrix};
  }
  // A part that is anywhere, with this density (that of a normal distribution has no (2 pi)^3).
  void AddAnywhere(double weight, double log_density) {
    parts_[count_++] = {std::log(weight) + log_density, Matrix6d::Zero()};
  }

  struct Value {
    double cost = 0;                          // - 2 log likelihood
    Matrix6d information = Matrix6d::Zero();  // that the error counts with: the parts' mean
    std::array<double, kMostParts> shares{};  // the probability of each part
  };
  Value At(const Vector6d& error) const {
    Value value;
    double largest = -HUGE_VAL;
    for (size_t k = 0; k < count_; ++k) {
      value.shares[k] = parts_[k].log_factor - 0.5 * error.dot(parts_[k].information * error);
      largest = std::max(largest, value.shares[k]);
    }
    double sum = 0;
    for (size_t k = 0; k < count_; ++k) {
      sum += value.shares[k] = std::exp(value.shares[k] - largest);
    }
    for (size_t k = 0; k < count_; ++k) {
      value.shares[k] /= sum;
      value.information += value.shares[k] * parts_[k].information;
    }
    value.cost = -2 * (largest + std::log(sum));
    return value;
  }

 private:
  struct Part {
    double log_factor;
    Matrix6d information;
  };
  std::array<Part, kMostParts> parts_;
  size_t count_ = 0;
};

}  // namespace raylift
