// The sum of many logarithms, taken of their product: one logarithm for some dozens of factors.

#pragma once

#include <cmath>

namespace raylift {

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
