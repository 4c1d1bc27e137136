// Odometry made from a true trajectory, with the faults that odometry has: to try how a walk's
// poses are smoothed on a scene of one's own.

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "raylift/geometry/rigid3.h"

namespace raylift {

// Errors of drift are drawn for each step of the way, so that they add up as in a random walk:
// their deviation grows with the way's root.
struct OdometryPerturbation {
  double drift_sigma = 0;     // of the position over a scene unit of way, per axis, scene units
  double turn_sigma_deg = 0;  // of the orientation over a scene unit of way, per axis
  double unit = 1;            // scene units per unit of the odometry
  double lost_share = 0;      // of the steps: the odometry begins anew somewhere
  double dropout_share = 0;   // of the poses, which are missing

  // Throws OptionError for a value out of its range.
  void Validate() const;
};

struct OdometryPose {
  size_t index = 0;  // in the trajectory
  Rigid3 cam_from_odometry;
};

// The odometry's world is the first camera's frame. The same seed gives the same errors.
std::vector<OdometryPose> PerturbOdometry(std::span<const Rigid3> cam_from_world,
                                          const OdometryPerturbation& perturbation, uint64_t seed);

}  // namespace raylift
