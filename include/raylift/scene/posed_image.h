// A reference photograph: its name, its lens and where it was taken.

#pragma once

#include <string>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

struct PosedImage {
  std::string name;  // as in the model: a path relative to the image folder
  Camera camera;
  Rigid3 cam_from_world;
};

}  // namespace raylift
