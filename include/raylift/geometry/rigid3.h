// Rigid motions of 3D space. A transform is named target_from_source: cam_from_world maps a point
// in world coordinates to camera coordinates, and products chain: a_from_c = a_from_b * b_from_c.

#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace raylift {

struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  // unit norm
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();         // scene units

  Eigen::Vector3d operator*(const Eigen::Vector3d& point_in_source) const {
    return rotation * point_in_source + translation;
  }
  Rigid3 operator*(const Rigid3& source_from_other) const {
    return {(rotation * source_from_other.rotation).normalized(),
            rotation * source_from_other.translation + translation};
  }
  Rigid3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return {inverse, -(inverse * translation)};
  }
  // The source origin's counterpart: for cam_from_world, the camera center in the world.
  Eigen::Vector3d OriginInSource() const { return -(rotation.conjugate() * translation); }

  bool IsFinite() const { return rotation.coeffs().allFinite() && translation.allFinite(); }
};

// The rotation exp(w): by the angle |w| in radians about the axis w.
Eigen::Quaterniond RotationFromVector(const Eigen::Vector3d& rotation_vector);

// The matrix of the cross product: Skew(a) * b = a x b.
inline Eigen::Matrix3d Skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return m;
}

// Angle in degrees of the rotation that separates two orientations; exact for tiny angles, too.
double AngleBetweenDeg(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b);

}  // namespace raylift
