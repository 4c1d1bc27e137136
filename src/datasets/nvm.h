// VisualSFM's NVM files, as far as data sets use them: the cameras. Private to datasets.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "raylift/geometry/rigid3.h"

namespace raylift {

struct NvmCamera {
  std::string name;
  double focal_px = 0;
  Rigid3 cam_from_world;
  double radial_distortion = 0;  // VisualSFM's, of the measured pixel
};

// The cameras of the first model: `name f qw qx qy qz cx cy cz k 0`, the quaternion world to
// camera, c the camera's center. InputError for anything else.
std::vector<NvmCamera> ReadNvmCameras(const std::filesystem::path& file);

}  // namespace raylift
