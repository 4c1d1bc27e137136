// Axes of files, each along one of ours in either direction.

#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include <Eigen/Core>

namespace raylift {

// Returns the 48 matrices that take axes to axes, the identity first; half of them are rotations,
// whose determinant is 1.
inline std::vector<Eigen::Matrix3d> SignedPermutations() {
  std::vector<Eigen::Matrix3d> all;
  std::array<int, 3> order = {0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Eigen::Matrix3d axes = Eigen::Matrix3d::Zero();
      for (int row = 0; row < 3; ++row) {
        axes(row, order[static_cast<size_t>(row)]) = (signs >> row) % 2 == 0 ? 1 : -1;
      }
      all.push_back(axes);
    }
  } while (std::next_permutation(order.begin(), order.end()));
  return all;
}

}  // namespace raylift
