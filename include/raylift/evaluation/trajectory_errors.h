// Errors of a trajectory as evo (Grupp 2017) defines them, without alignment: APE, of each pose,
// and RPE, of each step from one pose to the next.

#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "raylift/geometry/rigid3.h"

namespace raylift {

struct ErrorStatistics {
  double rmse = 0, mean = 0, median = 0, std = 0, min = 0, max = 0, sse = 0;
};
// Of no errors, zeros.
ErrorStatistics StatisticsOf(std::vector<double> errors);

struct TrajectoryErrors {
  std::string name;
  size_t poses = 0;
  ErrorStatistics ape_position, ape_rotation_deg;
  ErrorStatistics rpe_position, rpe_rotation_deg;
};

struct TrajectoryPose {
  Rigid3 estimated_cam_from_world;
  Rigid3 true_cam_from_world;
};

// With the true world_from_cam Q and the estimated P, the errors are those of Q_i^-1 P_i and of
// (Q_i^-1 Q_i+1)^-1 (P_i^-1 P_i+1).
TrajectoryErrors CompareTrajectories(std::string name, std::span<const TrajectoryPose> poses);

// Aligned columns, four rows for each trajectory.
std::string FormatTrajectoryText(std::span<const TrajectoryErrors> trajectories);

// [{name, poses, ape_position: {rmse, mean, median, std, min, max, sse}, ape_rotation_deg,
// rpe_position, rpe_rotation_deg}]
std::string FormatTrajectoryJson(std::span<const TrajectoryErrors> trajectories);

}  // namespace raylift
