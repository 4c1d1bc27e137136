// Quaternions of files that promise unit length.

#pragma once

#include <optional>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace raylift {

// What files of this kind may be off by rounding; more than that is another quantity.
inline constexpr double kUnitLengthTolerance = 1e-3;

// The unit quaternion, or none where the length is not 1 within the tolerance. One that is of unit
// length up to rounding stays as it is, so that it is written back with the same digits.
std::optional<Eigen::Quaterniond> UnitQuaternion(const Eigen::Vector4d& qvec_wxyz);

}  // namespace raylift
