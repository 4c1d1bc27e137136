// The axes that files have: each along one of ours, one way or the other.

#pragma once

#include <vector>

#include <Eigen/Core>

namespace raylift {

// Returns the 48 matrices that take axes to axes, the identity first; half of them are rotations,
// whose determinant is 1.
std::vector<Eigen::Matrix3d> SignedPermutations();

}  // namespace raylift
