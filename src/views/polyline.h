// Finds points on a polyline by their distance along it.

#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "raylift/base/error.h"

namespace raylift {

class Polyline {
 public:
  // Takes at least two points.
  explicit Polyline(std::vector<Eigen::Vector3d> points) : points_(std::move(points)), lengths_{0} {
    for (size_t i = 1; i < points_.size(); ++i) {
      lengths_.push_back(lengths_.back() + (points_[i] - points_[i - 1]).norm());
    }
  }

  double length() const { return lengths_.back(); }

  // Returns an end of the line for a length beyond it.
  Eigen::Vector3d At(double length) const {
    const double inner = std::clamp(length, 0.0, lengths_.back());
    const auto next = std::upper_bound(lengths_.begin() + 1, lengths_.end() - 1, inner);
    const auto i = static_cast<size_t>(next - lengths_.begin());
    const double share =
        (inner - lengths_[i - 1]) / std::max(lengths_[i] - lengths_[i - 1], 1e-300);
    return points_[i - 1] + share * (points_[i] - points_[i - 1]);
  }

 private:
  std::vector<Eigen::Vector3d> points_;
  std::vector<double> lengths_;  // from the first point to each
};

}  // namespace raylift
