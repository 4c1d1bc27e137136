// A photograph whose pose is looked for.

#pragma once

#include <string>

#include "raylift/geometry/camera.h"
#include "raylift/scene/pose_priors.h"

namespace raylift {

struct Query {
  std::string name;
  Camera camera;
  PosePriors priors = {};
};

}  // namespace raylift
