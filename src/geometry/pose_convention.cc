#include "raylift/geometry/pose_convention.h"

#include "raylift/base/error.h"

namespace raylift {
namespace {

using enum PoseConvention;

// A half turn about x: its own inverse.
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
