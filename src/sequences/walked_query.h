// Functions that smoothing a whole walk and tracking it share.

#pragma once

#include <vector>

#include "raylift/sequences/smooth_queries.h"

namespace raylift {

// The largest number of a photograph's poses that count, the likeliest; what is kept of a walk
// grows with it.
inline constexpr size_t kMostSinglePoses = 4;

// Returns a photograph's own pose and its alternatives, those with an invertible covariance; empty
// where its own has none.
std::vector<SinglePose> SinglePosesOf(const LocalizedQuery& query);

// Gives a photograph the walk's pose, or drops its own where that contradicts the walk; keeps its
// own where the walk's is not sure enough.
void TakeFromWalk(const SmoothedFrame& frame, const Query& photograph,
                  const SceneDistances& distances, double min_confidence, WalkedQuery& query);

}  // namespace raylift
