// Reads odometry as programs write it: poses by time, by the names of photographs, or in their
// order.

#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "io/scene/trajectory_file.h"

#include "raylift/geometry/rigid3.h"
#include "raylift/sequences/smoothing.h"

namespace raylift {

// One of the three kinds of poses is not empty. The world of each is the odometry's frame.
struct Odometry {
  std::vector<TimedPose> by_time = {};         // times grow, in the unit of the file
  std::map<std::string, Rigid3> by_name = {};  // of photographs
  std::vector<Rigid3> in_order = {};           // a pose per frame
  std::map<std::string, double> times = {};    // of photographs, where the file tells them
  std::vector<std::string> warnings = {};
};

// Reads any of the forms that ReadWalk() names. Throws InputError naming file and line for anything
// else.
Odometry ReadOdometry(const std::filesystem::path& odometry);

// Another way to read the odometry's poses: programs write x right and y down, y up, or a robot's
// axes.
struct OdometryReading {
  Eigen::Matrix3d cam_from_body = Eigen::Matrix3d::Identity();
  bool inverted = false;  // the poses are read as their inverses
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
