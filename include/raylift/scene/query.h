// A photograph whose pose is looked for.

#pragma once

#include <optional>
#include <string>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/pose_priors.h"

namespace raylift {

// The place of a photograph's camera on a rig. Photographs of one frame were taken at one moment and
// have one unknown pose together.
struct RigMount {
  std::string frame;
  int sensor = 0;  // among the rig's cameras: the first one that a frame has speaks for it
  Rigid3 cam_from_rig;
};

struct Query {
  std::string name;
  Camera camera;
  PosePriors priors = {};
  std::optional<RigMount> rig = std::nullopt;
};

}  // namespace raylift
