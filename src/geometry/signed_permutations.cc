#include "geometry/signed_permutations.h"

#include <algorithm>
#include <array>
#include <cstddef>

namespace raylift {

std::vector<Eigen::Matrix3d> SignedPermutations() {
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
