#include "raylift/geometry/rigid3.h"

#include <cmath>
#include <numbers>

#include "raylift/base/error.h"

namespace raylift {

Eigen::Quaterniond RotationFromVector(const Eigen::Vector3d& rotation_vector) {
  const double squared_angle = rotation_vector.squaredNorm();
  // sin(angle / 2) / angle; its series where the quotient would lose digits.
  double factor = 0.5 - squared_angle / 48;
  double w = 1 - squared_angle / 8;
  if (squared_angle > 1e-10) {
    const double angle = std::sqrt(squared_angle);
    factor = std::sin(0.5 * angle) / angle;
    w = std::cos(0.5 * angle);
  }
  return Eigen::Quaterniond(w, factor * rotation_vector.x(), factor * rotation_vector.y(),
                            factor * rotation_vector.z())
      .normalized();
}

double AngleBetweenDeg(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  const Eigen::Quaterniond difference = a.conjugate() * b;
  return 2 * std::atan2(difference.vec().norm(), std::abs(difference.w())) * 180 / std::numbers::pi;
}

namespace {

using enum PoseConvention;

// Returns a half turn about x, which is its own inverse.
Rigid3 CamFromOpenGlCam() { return {Eigen::Quaterniond(0, 1, 0, 0), Eigen::Vector3d::Zero()}; }

}  // namespace

Rigid3 CamFromWorld(const Rigid3& stored, PoseConvention convention) {
  switch (convention) {
    case kCamFromWorld:
      return stored;
    case kWorldFromCam:
      return stored.Inverse();
    case kOpenGlCamFromWorld:
      return CamFromOpenGlCam() * stored;
    case kWorldFromOpenGlCamera:
      return CamFromOpenGlCam() * stored.Inverse();
  }
  RAYLIFT_CHECK(false);
}

Rigid3 StoredPose(const Rigid3& cam_from_world, PoseConvention convention) {
  switch (convention) {
    case kCamFromWorld:
      return cam_from_world;
    case kWorldFromCam:
      return cam_from_world.Inverse();
    case kOpenGlCamFromWorld:
      return CamFromOpenGlCam() * cam_from_world;
    case kWorldFromOpenGlCamera:
      return (CamFromOpenGlCam() * cam_from_world).Inverse();
  }
  RAYLIFT_CHECK(false);
}

}  // namespace raylift
