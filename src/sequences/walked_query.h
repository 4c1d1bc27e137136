// What smoothing a whole walk and tracking it have in common.

#pragma once

#include <optional>

#include "raylift/sequences/smooth_queries.h"

namespace raylift {

// A photograph's own pose; nullopt where it has none, or no covariance that has an inverse.
std::optional<SinglePose> SinglePoseOf(const LocalizedQuery& query);

// The walk's pose takes the place of a photograph's own unless that is surer.
void TakeFromWalk(const SmoothedFrame& frame, const Query& photograph,
                  const SceneDistances& distances, double min_confidence, WalkedQuery& query);

}  // namespace raylift
