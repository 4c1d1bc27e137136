// The pose of a query from five matches to one reference and one match to another (E5+1; Zheng and
// Wu, ICCV 2015): the five give rotation and direction of the translation, the sixth its length.

#pragma once

#include <array>
#include <optional>
#include <span>

#include "estimation/solvers/five_point.h"
#include "estimation/solvers/p3p.h"
#include <Eigen/Core>

namespace raylift {

// A match to one reference: unit rays, the reference's in world axes.
struct RayPair {
  Eigen::Vector3d query_ray;
  Eigen::Vector3d reference_ray;
};

// cam_from_world of the query for a reference at `center` (rays in world axes) and a translation of
// `length` along the relative pose's direction.
SolverPose QueryPose(const RelativePose& relative, const Eigen::Vector3d& center, double length);

// The length of the translation from the first reference at which the sixth match, to a reference
// at `sixth_center`, meets its epipolar constraint; none where it is not positive and finite, or
// where the sixth point would lie behind the query or behind its own reference. None, either, where
// the match says nothing of the length, its rays lying in one plane with the direction.
std::optional<double> TranslationLength(const RelativePose& relative, const Eigen::Vector3d& center,
                                        const RayPair& sixth, const Eigen::Vector3d& sixth_center);

}  // namespace raylift
