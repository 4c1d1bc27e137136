// The likelihood of an error of which several explanations are possible, each normally distributed
// or, without information, anywhere.

#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include "sequences/chain.h"
#include <Eigen/LU>

namespace raylift {

class Mixture {
 public:
  // A part of the weight, with this information (the inverse of a covariance).
  void Add(double weight, const Matrix6& information) {
    parts_.push_back({std::log(weight) + 0.5 * std::log(information.determinant()), information});
  }
  // A part that is anywhere, with this density (that of a normal distribution has no (2 pi)^3).
  void AddAnywhere(double weight, double log_density) {
    parts_.push_back({std::log(weight) + log_density, Matrix6::Zero()});
  }

  struct Value {
    double cost = 0;                        // - 2 log likelihood
    Matrix6 information = Matrix6::Zero();  // that the error counts with: the parts' mean
    std::vector<double> shares;             // the probability of each part
  };
  Value At(const Vector6& error) const {
    std::vector<double> logs;
    double largest = -HUGE_VAL;
    for (const Part& part : parts_) {
      logs.push_back(part.log_factor - 0.5 * error.dot(part.information * error));
      largest = std::max(largest, logs.back());
    }
    Value value;
    double sum = 0;
    for (const double log : logs) sum += value.shares.emplace_back(std::exp(log - largest));
    for (size_t k = 0; k < parts_.size(); ++k) {
      value.shares[k] /= sum;
      value.information += value.shares[k] * parts_[k].information;
    }
    value.cost = -2 * (largest + std::log(sum));
    return value;
  }

 private:
  struct Part {
    double log_factor;
    Matrix6 information;
  };
  std::vector<Part> parts_;
};

}  // namespace raylift
