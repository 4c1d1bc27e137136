// A walk: photographs in the order in which they were taken, and the camera's motion between them
// by odometry (ARKit, ARCore, a VIO, visual odometry of unknown scale), in a frame of its own.

#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "raylift/geometry/rigid3.h"

namespace raylift {

// A frame of the walk.
struct WalkFrame {
  size_t query = 0;  // in the list of names
  double time_s = 0;
  Rigid3 cam_from_odometry;
};

struct Walk {
  std::string folder = {};  // "NAME/", which its photographs' names start with, if it is of a list
  std::vector<WalkFrame> frames = {};  // at least two, in the order of their times, which differ
  std::vector<std::string> warnings = {};
  Rigid3 cam_from_body = {};  // that the frames' poses were led to the camera by
};

// Reads odometry of the named photographs. `odometry` is one of
//
//   a TUM trajectory, lines `time tx ty tz qx qy qz qw` (camera to odometry's world, x right, y
//     down, z forward), whose times must grow. A photograph takes the pose that is nearest to its
//     time, within half of the median step between poses, unless it is nearer to another's.
//   EuRoC's CSV, `time [ns], px, py, pz, qw, qx, qy, qz, ...` (body to world): by time, too.
//   KITTI's poses, lines of the upper three rows of a matrix (camera to world): the photographs'
//     names are the numbers of lines from 0, or there is a line for each in the order of names.
//   a COLMAP model's folder, or a pose file, lines `name qw qx qy qz tx ty tz` (world to camera); a
//     kapture data set; nerfstudio's transforms.json: names tell, without the leading folders that
//     photographs are called without.
//   lines of JSON, `{"timestamp": SECONDS, "name": PHOTOGRAPH, "transform": [...]}`, of which one
//     of the first two may be missing: a 4x4 matrix, camera to world, by rows or columns, of a
//     camera with x right, y up, z backward, as ARKit and ARCore have it.
//
// The times of the photographs are in the file `times` (lines `name seconds`, called as those of
// odometry may be) or, where that is empty, in the odometry, or in their names as TUM's data sets
// have them (rgb/1305031102.175304.png); where poses go by names and these are no times,
// photographs were taken in the order of their names, in which numbers count as such, one a second.
// Times too large for seconds are milli-, micro- or nanoseconds. Photographs without a pose are
// left out, with a warning. `cam_from_body` leads from what the odometry moves to the camera.
// Throws InputError for anything else, for times of photographs that are the same, where fewer than
// two photographs have a pose, and where the camera does not move at all.
Walk ReadWalk(const std::filesystem::path& odometry, const std::filesystem::path& times,
              std::span<const std::string> names, const Rigid3& cam_from_body = {});

// Reads the odometry of one walk, as ReadWalk() does, or of several: `odometry` may be a list of
// lines
//
//   walk FOLDER ODOMETRY [TIMES]
//
// of the photographs whose names start with FOLDER/. Paths are relative to the list's folder, and
// names with blanks stand in double quotes. `times` is for walks whose line and odometry tell none.
// Odometry and times may call photographs with their FOLDER or without. Photographs of no walk are
// left out, with a warning. Throws InputError also for a walk that has no photographs or shares
// them with another.
std::vector<Walk> ReadWalks(const std::filesystem::path& odometry,
                            const std::filesystem::path& times, std::span<const std::string> names,
                            const Rigid3& cam_from_body = {});

}  // namespace raylift
