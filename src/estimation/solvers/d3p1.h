// The pose of a query from three matches to one reference whose depths are known up to a common
// factor, and one match to another reference (D3+1): the three give rotation and direction of the
// translation by P3P, whatever the factor, and the fourth gives its length as the sixth match of
// E5+1 does (e5p1.h). For depth whose scale is each reference's own, as of a single image.

#pragma once

#include <array>
#include <span>

#include "estimation/solvers/e5p1.h"
#include <Eigen/Core>

namespace raylift {

// The relative poses of three matches: unit rays of the query, and the points from the reference's
// center, in world axes, up to a common positive factor. Returns their count; 0 where the query is
// at the reference's center, as that has no direction, and where P3P has no solution.
int SolveRelativePoseByDepth(const std::array<Eigen::Vector3d, 3>& query_rays,
                             const std::array<Eigen::Vector3d, 3>& points_from_center,
                             std::span<RelativePose, 4> poses);

}  // namespace raylift
