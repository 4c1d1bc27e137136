// Poses from two 2D-3D matches, where the camera's center or its vertical direction is known.

#pragma once

#include <array>
#include <optional>
#include <span>

#include "estimation/solvers/p3p.h"
#include <Eigen/Core>

namespace raylift {

// The rotation that turns the directions of two points from the center into their rays, as nearly
// as the angle between them allows. `rays`: unit vectors in the camera frame. None where the rays,
// or the points as seen from the center, lie in one line.
std::optional<SolverPose> SolvePoseAtCenter(const std::array<Eigen::Vector3d, 2>& rays,
                                            const std::array<Eigen::Vector3d, 2>& points_in_world,
                                            const Eigen::Vector3d& center_in_world);

// The poses that turn the world's direction of gravity into the camera's and put both points onto
// their rays, in front of the camera (UP2P; Kukelova, Bujnak and Pajdla, "Closed-form solutions to
// minimal absolute pose problems with known vertical direction", ACCV 2010, by the two depths).
// All vectors but the points have length 1. Returns their count; 0 for a degenerate sample: both
// rays level, or one point above the other. `centers` are those of the cameras that see the points,
// in the frame of the pose: zeros, but of a rig.
int SolveUprightPose(const std::array<Eigen::Vector3d, 2>& centers,
                     const std::array<Eigen::Vector3d, 2>& rays,
                     const std::array<Eigen::Vector3d, 2>& points_in_world,
                     const Eigen::Vector3d& down_in_cam, const Eigen::Vector3d& down_in_world,
                     std::span<SolverPose, 2> poses);

}  // namespace raylift
