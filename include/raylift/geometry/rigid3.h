// Rigid motions of 3D space. A transform is named target_from_source: cam_from_world maps a point
// in world coordinates to camera coordinates, and products chain: a_from_c = a_from_b * b_from_c.
// Files of others may store poses the other way round or in other axes: see PoseConvention.

#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "raylift/base/enum_names.h"

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
  // Returns the target's origin in the source's coordinates: for cam_from_world, the camera center.
  Eigen::Vector3d OriginInSource() const { return -(rotation.conjugate() * translation); }

  bool IsFinite() const { return rotation.coeffs().allFinite() && translation.allFinite(); }
};

// Returns the rotation exp(w): by the angle |w| in radians about the axis w.
Eigen::Quaterniond RotationFromVector(const Eigen::Vector3d& rotation_vector);

// Returns the matrix of the cross product: Skew(a) * b = a x b.
inline Eigen::Matrix3d Skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return m;
}

// Returns the angle in degrees of the rotation between two orientations; exact for tiny angles,
// too.
double AngleBetweenDeg(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b);

// The convention of poses in a file. In memory all poses are cam_from_world with the camera's x
// right, y down, z forward; files of others may hold the inverse, or cameras in OpenGL's axes.

enum class PoseConvention {
  kCamFromWorld,           // ours, and COLMAP's
  kWorldFromCam,           // its inverse
  kOpenGlCamFromWorld,     // the camera's y up, z backward
  kWorldFromOpenGlCamera,  // as in NeRF's transforms.json
};
template <>
inline constexpr auto kEnumNames<PoseConvention> = std::to_array<EnumName<PoseConvention>>({
    {PoseConvention::kCamFromWorld, "cam_from_world", "world to camera"},
    {PoseConvention::kWorldFromCam, "world_from_cam", "camera to world"},
    {PoseConvention::kOpenGlCamFromWorld, "opengl", "world to camera in OpenGL's axes"},
    {PoseConvention::kWorldFromOpenGlCamera, "world_from_opengl",
     "camera to world in OpenGL's axes"},
});

// Returns the pose that a stored one means.
Rigid3 CamFromWorld(const Rigid3& stored, PoseConvention convention);
// Returns the pose as it would be stored, the inverse of CamFromWorld().
Rigid3 StoredPose(const Rigid3& cam_from_world, PoseConvention convention);

}  // namespace raylift
