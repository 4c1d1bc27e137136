// Poses in the order of time, as tools for trajectories (evo, rpg_trajectory_evaluation, rerun) read
// them: both formats hold camera to world, the camera's x right, y down, z forward.

#pragma once

#include <filesystem>
#include <span>

#include "raylift/geometry/rigid3.h"

namespace raylift {

struct TimedPose {
  double time_s;
  Rigid3 cam_from_world;
};

// TUM's: lines `time tx ty tz qx qy qz qw`, in the given order.
void WriteTumTrajectory(const std::filesystem::path& path, std::span<const TimedPose> poses);

// KITTI's: a line per pose, the upper three rows of its matrix, row by row; times and names have no
// place in it.
void WriteKittiTrajectory(const std::filesystem::path& path, std::span<const TimedPose> poses);

}  // namespace raylift
