// The same feature again: detectors find some twice, a fraction of a pixel apart, and matches come
// in repeated rows. Keypoints that coincide are one, with one error, and a match that repeats
// another one says nothing new.

#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/keypoints.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct Repeats {
  KeypointNumbers keypoints;  // of which those that coincide are one
  // Of each match the one that it repeats, or itself: both are of one keypoint and one reference,
  // and show or are the same there.
  std::vector<size_t> of_2d2d, of_2d3d;
};

// Pixels that are no farther apart than `within_px` coincide; and points that are not, as seen by
// the query's camera from `from` (world). 0: none does, and no match repeats another one.
Repeats FindRepeats(const PoseProblem& problem, double within_px, const Eigen::Vector3d& from);

}  // namespace raylift
