// Writes poses for other tools: trajectories (evo, rpg_trajectory_evaluation, rerun), and kapture's
// folders.

#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/geometry/rigid3.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct TimedPose {
  double time_s;
  Rigid3 cam_from_world;
};

// Returns the time that is a photograph's name but for folder and extension, as of TUM's frames:
// seconds; nullopt where it is none.
std::optional<double> TimeInName(const std::string& name);

// Returns the seconds of a unit of times whose file does not say it, by the size that times of this
// century have in seconds, milli-, micro- and nanoseconds.
double SecondsPerTick(double latest);

// Writes TUM's format: lines `time tx ty tz qx qy qz qw`, in the given order.
void WriteTumTrajectory(const std::filesystem::path& path, std::span<const TimedPose> poses);

// Reads it back; `#` comments and empty lines are skipped. Throws InputError for anything else, for
// a file without poses, and for times that do not grow.
std::vector<TimedPose> ReadTumTrajectory(const std::filesystem::path& path);

// Writes KITTI's format: a line per pose, the upper three rows of its matrix, row by row; it has no
// times and names.
void WriteKittiTrajectory(const std::filesystem::path& path, std::span<const TimedPose> poses);

// Writes posed images as a kapture data set (format 1.1): sensors.txt, trajectories.txt and
// records_camera.txt to `folder`/sensors. Equal cameras are one sensor; the timestamp of an image
// is its place. Throws InputError where kapture has no such camera model or cannot hold a name;
// photographs belong to `folder`/sensors/records_data.
void WriteKapture(const std::filesystem::path& folder, std::span<const PosedImage> images);

}  // namespace raylift
