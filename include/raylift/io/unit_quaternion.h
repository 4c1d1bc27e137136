// Quaternions of files that promise unit length, and vectors that promise none.

#pragma once

#include <cmath>
#include <optional>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace raylift {

// What files of this kind may be off by rounding; more than that is another quantity.
inline constexpr double kUnitLengthTolerance = 1e-3;

// The unit quaternion, or none where the length is not 1 within the tolerance. One that is of unit
// length up to rounding stays as it is, so that it is written back with the same digits.
std::optional<Eigen::Quaterniond> UnitQuaternion(const Eigen::Vector4d& qvec_wxyz);

// Whether a vector of any length can be normalized: it is not zero, nor so short or long that its
// squares leave the range of numbers.
template <int N>
bool HasDirection(const Eigen::Matrix<double, N, 1>& vector) {
  return std::isnormal(vector.squaredNorm());
}

}  // namespace raylift
