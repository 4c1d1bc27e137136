// Reads and answers requests of the GeoPose Protocol of Open AR Cloud, version 2: a request holds a
// device's sensors and what they read, the answer is OGC GeoPose.
// https://github.com/OpenArCloud/oscp-geopose-protocol

#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "service/localize_request.h"
#include "service/scene_place.h"

#include "raylift/localization/localizer.h"

namespace raylift {

struct GeoPoseRequest {
  std::string id;
  int64_t timestamp_ms = 0;
  LocalizeRequest photograph;              // named by the id
  std::optional<RoughPosition> near = {};  // the newest reading, else the newest prior pose
};

// Reads a request:
//
//   cameraReadings       the first that is no depth is localized: a photograph's file (JPG, ...) or
//                        GRAY8 or RGBA32, with `params` as its camera ("UNKNOWN": as without any)
//   geolocationReadings  the newest tells which scene is near, and with an accuracy above 0 it is a
//                        prior of the position. Its heading is the direction of travel, which says
//                        nothing of the camera's
//   priorPoses           tell which scene is near
//
// Other sensors are not looked at: how they lie on the device is not said. Names of members are
// those of the protocol or, where they differ, those that its client sends. Throws Problem, or
// InputError "FIELD: ...".
GeoPoseRequest ReadGeoPoseRequest(std::string_view body, uint64_t max_pixels);

// Returns the answer, with the members `scene`, `verdict` and `confidence` besides the protocol's.
std::string FormatGeoPoseAnswer(const GeoPoseRequest& request, const std::string& scene,
                                const LocalizedQuery& localized, const ScenePlace::Camera& camera);

}  // namespace raylift
