// A photograph whose pose is looked for.

#pragma once

#include <string>

#include "raylift/geometry/camera.h"

namespace raylift {

struct Query {
  std::string name;
  Camera camera;
};

}  // namespace raylift
