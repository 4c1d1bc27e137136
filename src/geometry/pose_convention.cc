#include "raylift/geometry/pose_convention.h"

#include <array>
#include <utility>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using enum PoseConvention;

constexpr std::array<std::pair<PoseConvention, std::string_view>, 4> kNames = {{
    {kCamFromWorld, "cam_from_world"},
    {kWorldFromCam, "world_from_cam"},
    {kOpenGlCamFromWorld, "opengl"},
    {kWorldFromOpenGlCamera, "world_from_opengl"},
}};

// A half turn about x: its own inverse.
Rigid3 CamFromOpenGlCam() { return {Eigen::Quaterniond(0, 1, 0, 0), Eigen::Vector3d::Zero()}; }

}  // namespace

std::string_view ToString(PoseConvention convention) {
  for (const auto& [value, name] : kNames) {
    if (value == convention) return name;
  }
  return {};
}

std::optional<PoseConvention> PoseConventionFromName(std::string_view name) {
  for (const auto& [value, known] : kNames) {
    if (known == name) return value;
  }
  return std::nullopt;
}

std::string PoseConventionNames() {
  std::string names;
  for (const auto& [value, name] : kNames) names += (names.empty() ? "" : "|") + std::string(name);
  return names;
}

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
