// What smoothing a whole walk and tracking it have in common.

#pragma once

#include <vector>

#include "raylift/sequences/smooth_queries.h"

namespace raylift {

// So many poses of a photograph count, the likeliest; what is kept of a walk grows with them.
inline constexpr size_t kMostSinglePoses = 4;

// A photograph's own pose and its alternatives, those with a covariance that has an inverse; none
// where its own has not.
std::vector<SinglePose> SinglePosesOf(const LocalizedQuery& query);

// The walk's pose takes the place of a photograph's own unless that is surer.
void TakeFromWalk(const SmoothedFrame& frame, const Query& photograph,
                  const SceneDistances& distances, double min_confidence, WalkedQuery& query);

}  // namespace raylift
