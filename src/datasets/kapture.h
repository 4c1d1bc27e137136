// The sensors, records and trajectories of a kapture data set (format 1.x): CSV files below
// `sensors`; and those of a capture (github.com/microsoft/lamar-benchmark, CAPTURE.md), which have
// other names, no header, and all poses the other way round.

#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

struct KaptureImage {
  std::string name;  // below sensors/records_data
  uint64_t timestamp = 0;
  std::optional<Camera> camera;          // none: its model is unknown
  std::optional<Rigid3> cam_from_world;  // none: not in the trajectories, or only a part of it
};

// All records of cameras, by name. Poses of rigs are composed with the sensors' places in them.
// `folder` holds the folder `sensors`. Throws InputError naming file and line for anything else.
std::vector<KaptureImage> ReadKapture(const std::filesystem::path& folder);

// The same of a session of a capture, whose names are below `session`/raw_data. With a file of
// lines "timestamp, sensor or rig" those images alone.
std::vector<KaptureImage> ReadCaptureSession(const std::filesystem::path& session,
                                             const std::filesystem::path& keys = {});

// Returns when images were taken, by name, in seconds.
std::map<std::string, double> TimesOf(std::span<const KaptureImage> images);

}  // namespace raylift
