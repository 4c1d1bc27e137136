// What the poses of a file mean. Everything here is cam_from_world with the camera's x right, y
// down, z forward; files of others may hold the inverse, or cameras in OpenGL's axes.

#pragma once

#include <optional>
#include <string_view>

#include "raylift/base/enum_names.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

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

// The pose that a stored one means.
Rigid3 CamFromWorld(const Rigid3& stored, PoseConvention convention);
// The one that would be stored: the other way round.
Rigid3 StoredPose(const Rigid3& cam_from_world, PoseConvention convention);

}  // namespace raylift
