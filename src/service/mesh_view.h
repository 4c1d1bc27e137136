// Renders the scene's surface as a photograph would show it.

#pragma once

#include <string>
#include <string_view>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/localization/scene.h"

namespace raylift {

struct ViewRequest {
  Camera camera;
  Rigid3 cam_from_world;
};

// Reads {"camera": "MODEL width height params...", "cam_from_world": {"qvec", "tvec"}}, as answers
// have the latter. Throws Problem, or InputError "FIELD: ...".
ViewRequest ReadViewRequest(std::string_view body);

// Returns what the camera sees of the scene's mesh or cloud: a JPEG of at most 960 pixels along its
// longer side. Throws Problem where there is none.
std::string RenderView(const ViewRequest& view, const Scene& scene);

}  // namespace raylift
