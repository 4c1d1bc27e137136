// Facts and pictures of a query for the page of `raylift localize`, whichever pose it has, and what
// a walk adds to them.

#pragma once

#include "report/scene_json.h"
#include <nlohmann/json.hpp>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/localization/localizer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/photographs.h"
#include "raylift/sequences/smooth_queries.h"

namespace raylift {

// Pictures are at most this wide.
inline constexpr int kPagePictureWidthPx = 640;

// Returns counts, verdict and uncertainty.
nlohmann::ordered_json QueryFacts(const LocalizedQuery& query);

// Renders the mesh from the pose, and its edges and creases on a transparent ground, as
// data URIs: {"rendering": ..., "edges": ...}.
nlohmann::ordered_json SeenFromPose(const Camera& camera, const Rigid3& cam_from_world,
                                    const RayCaster& mesh);

// Adds to a query's part of the page, {"query": ..., "scene": ...}, the walk's pose and verdict,
// and what the walk did with it. Renders a pose that is not near the photograph's own, unless
// `mesh` is null.
void TakeWalk(const WalkedQuery& walked, const Query& query, const RayCaster* mesh,
              nlohmann::ordered_json& part);

// Adds the pose that the photograph had by itself where the walk has another.
void AddSinglePose(const WalkedQuery& walked, SceneJson& scene);

// Returns the frames with a pose, walk by walk in the order of their times, and what each walk's
// odometry was: {"frames": [{"query", "walk", "time_s", "role", "lost_before"}], "odometry":
// [{"folder", "scale", "step_sigma", "step_rotation_sigma_deg"}]}; the last three only where the
// walk told something.
nlohmann::ordered_json WalkJson(const WalkedQueries& walked);

}  // namespace raylift
