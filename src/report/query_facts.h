// What the page of `raylift localize` says and shows of a query, whichever pose it has.

#pragma once

#include <nlohmann/json.hpp>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/localization/localizer.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {

// Pictures are at most this wide.
inline constexpr int kPagePictureWidthPx = 640;

// Returns counts, verdict and uncertainty.
nlohmann::ordered_json QueryFacts(const LocalizedQuery& query);

// Renders the mesh from the pose, and its edges and creases on a transparent ground, as
// data URIs: {"rendering": ..., "edges": ...}.
nlohmann::ordered_json SeenFromPose(const Camera& camera, const Rigid3& cam_from_world,
                                    const RayCaster& mesh);

}  // namespace raylift
