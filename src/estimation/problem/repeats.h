// Repeated features: detectors find some twice, a fraction of a pixel apart, and matches come in
// repeated rows. Keypoints that coincide are one, with one error, and a match that repeats another
// one says nothing new.

#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/keypoints.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct Repeats {
  KeypointNumbers keypoints;  // those that coincide have one number
  // These hold for each match the index of the one that it repeats, or its own: both are of one
  // keypoint and one reference, and their pixels or points there coincide.
  std::vector<size_t> of_2d2d, of_2d3d;
};

// Returns the 2D-2D match that a 3D point was lifted from: the one that it names or has beside it
// in the lists; nullopt where it is of none.
std::optional<size_t> PairOf(const PoseProblem& problem, size_t match_2d3d);

// Returns the reference that a 3D point names, or else that of its pair; nullopt where it is of
// none of the problem's.
std::optional<size_t> ReferenceOf(const PoseProblem& problem, size_t match_2d3d);

// Finds the repeats of a problem. Pixels that are no farther apart than `within_px` coincide; with
// 0 none does, and no match repeats another one. The points of a pair that repeats another one
// repeat that one's. Points of no pair coincide by their 3D distance, which may be what those
// pixels span at its distance from `from` (world), about where the cameras are; without any pairs
// nothing tells where that is.
Repeats FindRepeats(const PoseProblem& problem, double within_px, const Eigen::Vector3d& from);

}  // namespace raylift
