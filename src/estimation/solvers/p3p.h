// The pose of a camera from three points (P3P), by the Lambda Twist of Persson and Nordberg (ECCV
// 2018): the three distance equations define two quadratic forms; one real root of a cubic makes a
// combination of them degenerate, that is a pair of planes, and each plane leaves a quadratic.

#pragma once

#include <array>
#include <span>

#include <Eigen/Core>

namespace raylift {

// cam_from_world with the rotation as a matrix, as the solvers make it.
struct SolverPose {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
};

// `rays` are unit vectors in the camera frame. Writes the poses that put all three points in front
// of the camera (along their rays) and returns their count, 0 to 4; 0 for collinear or coinciding
// points. All poses are finite.
int SolveP3p(const std::array<Eigen::Vector3d, 3>& rays,
             const std::array<Eigen::Vector3d, 3>& points_in_world, std::span<SolverPose, 4> poses);

}  // namespace raylift
