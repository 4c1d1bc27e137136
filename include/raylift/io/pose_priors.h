// Reads priors of queries' poses and focal lengths: from a plain text file, or from the tags that
// cameras write into their photographs.

#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/geodesy.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Reads the priors of queries, by their names. Lines of such a file:
//
//   # the camera's center in the world and its standard deviation, one or per axis
//   day/001.jpg position 465203.1 5428113.9 248.0 5
//   day/002.jpg position 465210.6 5428115.2 247.1 3 3 10
//   # the same in another system: longitude, latitude and height (easting first, always),
//   # standard deviations in meters along east, north and up
//   day/003.jpg position 8.40444 49.01372 115.2 3 3 10 crs=EPSG:4326
//   # down in the camera's frame (x right, y down, z forward), standard deviation in degrees
//   day/001.jpg gravity 0.02 0.998 0.05 1
//   # degrees clockwise from north to where the camera looks, or, where it looks straight down, to
//   # the top of its image; and what is right for who views it (default: 1 0 0, x)
//   day/001.jpg heading 46 10
//   day/002.jpg heading 46 10 0 -1 0
//   # all of the rotation, world to camera (qw qx qy qz), standard deviation in degrees
//   day/001.jpg orientation 0.1 -0.7 0.7 0.1 2
//   # a position and an orientation: qw qx qy qz tx ty tz, world to camera, as in pose files, and
//   # the standard deviations of both
//   day/004.jpg pose 0.5 0.5 -0.5 0.5 2.5 1.2 -4 1 5
//   # from the camera's center along its optical axis to the surface, by a laser, and its standard
//   # deviation; in the world's unit, or in meters, where its system tells how long these are
//   day/002.jpg range 41.3 0.3
//   day/003.jpg range 41.3 0.3 m
//   # the camera's focal length is the given one up to this factor either way
//   day/002.jpg focal_range 1.5
//   # the focal length's standard deviation as a share of it
//   day/001.jpg focal_sigma 0.002
//   # the world's own system, for positions in another (WorldFrame::Parse), before these
//   * world_crs EPSG:32615
//   # down and north in the world: where no line says them, those of the place on the earth where
//   # the world's frame is known, else 0 0 -1 and 0 1 0
//   * world_down 0 0 -1
//   * world_north 0 1 0
//
// `#` comments and empty lines are skipped. Throws InputError for anything else, for what is said
// twice, and for places where the world's system is not meant for. Where transformations are rough,
// `warnings` says so.
std::map<std::string, PosePriors> ReadPosePriors(const std::filesystem::path& file,
                                                 const std::optional<WorldFrame>& world = {},
                                                 std::vector<std::string>* warnings = nullptr);

// Reads the priors of several texts, as of photographs, each by itself; of one name the first
// counts.
struct PriorText {
  std::filesystem::path path_for_messages;
  std::string lines;
};
std::map<std::string, PosePriors> ParsePosePriors(std::span<const PriorText> texts,
                                                  const std::optional<WorldFrame>& world = {},
                                                  std::vector<std::string>* warnings = nullptr);
// Reads the priors of a file's text.
std::map<std::string, PosePriors> ParsePosePriors(const std::filesystem::path& path_for_messages,
                                                  std::string text,
                                                  const std::optional<WorldFrame>& world = {},
                                                  std::vector<std::string>* warnings = nullptr);

// Gives each query its priors of such a file. What the query list says of the focal length holds
// where the file does not mention it. Returns the warnings. Throws InputError where the file knows
// none of the queries.
std::vector<std::string> TakePosePriors(const std::filesystem::path& file, std::span<Query> queries,
                                        const std::optional<WorldFrame>& world = {});
// Gives the queries priors that were read from there.
void TakePosePriors(const std::map<std::string, PosePriors>& priors,
                    const std::filesystem::path& path_for_messages, std::span<Query> queries);

// The position and orientation that a photograph states, by EXIF and the XMP of DJI's and Autel's
// drones.
struct PhotographTags {
  struct Position {
    Eigen::Vector3d point;    // longitude, latitude in degrees, height in meters
    Eigen::Vector3d sigma_m;  // along east, north and up
    std::string crs;          // that of WGS 84 which the height is of
  };
  std::optional<Position> position;
  std::optional<Eigen::Vector3d> down_in_cam;
  std::optional<double> heading_deg;  // of where right_in_cam is the viewer's right
  Eigen::Vector3d right_in_cam = Eigen::Vector3d::UnitX();
  double heading_sigma_deg = 0;
  std::optional<double> range_m;  // by a laser along the optical axis
  // Says for the user what was found and what was not taken: "position +-3 m, gimbal".
  std::string summary;
};
PhotographTags ReadPhotographTags(const std::filesystem::path& file);

// Returns the standard deviations, along east, north and up, of a GNSS position of this stated
// error, with or without a height.
Eigen::Vector3d GnssSigmaMeters(double stated_error_m, bool has_height = true);

// Returns the lines of such a file for what the photograph `name` states.
std::string FormatPhotographPriors(const std::string& name, const PhotographTags& tags);

// Returns the line that says that a focal length is known up to a factor.
std::string FormatFocalRange(const std::string& name, double factor);

// Gives each query the priors that its photograph states. Returns the warnings. Throws InputError
// where no photograph states any.
std::vector<std::string> TakePhotographPriors(const std::filesystem::path& images,
                                              const WorldFrame& world, std::span<Query> queries);

}  // namespace raylift
