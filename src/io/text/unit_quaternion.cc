#include "raylift/io/unit_quaternion.h"

#include <cmath>

namespace raylift {

std::optional<Eigen::Quaterniond> UnitQuaternion(const Eigen::Vector4d& qvec_wxyz) {
  constexpr double kRounding = 1e-12;
  Eigen::Quaterniond q(qvec_wxyz[0], qvec_wxyz[1], qvec_wxyz[2], qvec_wxyz[3]);
  const double deviation = std::abs(q.norm() - 1);
  if (!(deviation <= kUnitLengthTolerance)) {
    return std::nullopt;
  }
  if (deviation > kRounding) {
    q.normalize();
  }
  return q;
}

}  // namespace raylift
