// Odometry as programs write it: poses by time, by the names of photographs, or in their order.

#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "io/scene/trajectory_file.h"

#include "raylift/geometry/rigid3.h"

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

}  // namespace raylift
