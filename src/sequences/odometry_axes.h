// The axes that odometry's camera has: programs write x right and y down, y up, or a robot's.

#pragma once

#include <optional>
#include <span>

#include "raylift/sequences/smoothing.h"

namespace raylift {

// Another way to read the odometry's poses.
struct OdometryReading {
  Eigen::Matrix3d cam_from_body = Eigen::Matrix3d::Identity();
  bool inverted = false;  // they lead from the odometry's world to what it moves, or back
};

struct BetterReading {
  std::optional<OdometryReading>
      reading;                // nullopt where several are as good, as of a straight way
  double median_deg;          // between the directions of steps that odometry and frames say
  double median_deg_as_read;  // the same as the poses were read
};

// Compares the directions in which the camera moves and turns between frames that have poses of
// their own, for all axes along those of the camera. nullopt where the poses agree best as they
// were read, or too few steps tell.
std::optional<BetterReading> FindBetterReading(std::span<const WalkEvidence> frames);

}  // namespace raylift
