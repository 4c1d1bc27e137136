// The pose of a rig from three points, each seen by a camera of its own (generalized P3P; Nister and
// Stewenius, "A minimal solution to the generalised 3-point pose problem", JMIV 2007). The distances
// between the points are three quadratic equations in how far along its ray each lies; two of them
// are eliminated linearly, which leaves a polynomial of degree eight in one.

#pragma once

#include <array>
#include <span>

#include "estimation/solvers/p3p.h"
#include <Eigen/Core>

namespace raylift {

inline constexpr int kMaxGeneralizedP3pSolutions = 8;

// `centers` are those of the cameras that see the points, `rays` unit vectors, both in the rig's
// frame. Writes the poses (rig_from_world) that put all points in front of their cameras, along the
// rays, and returns their count; 0 for collinear or coinciding points. All poses are finite.
int SolveGeneralizedP3p(const std::array<Eigen::Vector3d, 3>& centers,
                        const std::array<Eigen::Vector3d, 3>& rays,
                        const std::array<Eigen::Vector3d, 3>& points_in_world,
                        std::span<SolverPose, kMaxGeneralizedP3pSolutions> poses);

}  // namespace raylift
