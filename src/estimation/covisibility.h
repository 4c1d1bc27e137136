// Which references of a problem see the same part of the scene.

#pragma once

#include <vector>

#include "raylift/scene/pose_problem.h"

namespace raylift {

// For problems whose clusters are not known from an SfM model: references are linked where a query
// keypoint matches both. The cluster of each reference, numbered by first member from 0.
std::vector<int> ClusterBySharedKeypoints(const PoseProblem& problem);

}  // namespace raylift
