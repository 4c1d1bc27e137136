// Reads the metadata of photographs: EXIF, a small TIFF file in a JPEG, and what drones add to it
// as XMP, a small XML file there.

#pragma once

#include <istream>
#include <optional>
#include <string>
#include <string_view>

#include <Eigen/Core>

#include "raylift/scene/photographs.h"

namespace raylift {

// The GPS tags of EXIF. The numbers are as the file has them, in range or not.
struct GpsTags {
  double latitude_deg = 0;
  double longitude_deg = 0;
  std::optional<double> altitude_m = std::nullopt;
  std::optional<double> horizontal_error_m = std::nullopt;
  // The direction that the camera looks in, clockwise from north.
  std::optional<double> direction_deg = std::nullopt;
  bool direction_is_magnetic = false;
};

// The tags in which DJI's and Autel's drones describe the camera.
struct DroneTags {
  // Angles of the gimbal: clockwise from north, above the horizon, clockwise about the axis.
  std::optional<double> yaw_deg, pitch_deg, roll_deg;
  std::optional<double> absolute_altitude_m;  // above the sea's level or the ellipsoid
  std::optional<double> relative_altitude_m;  // above where it took off
  // Standard deviations of positions by RTK, along east, north and up.
  std::optional<Eigen::Vector3d> rtk_sigma_m;
  // The distance to what is in the middle of the picture, by a laser.
  std::optional<double> range_m;
  std::optional<std::array<double, 9>> calibration;  // see LensTags
};

struct Exif {
  bool is_jpeg = false;  // else nothing is read
  // With 1 the picture is as stored; with 2 to 8 viewers flip and turn it, from 5 on so that the
  // sides change places.
  int orientation = 1;
  std::optional<double> focal_mm = std::nullopt;
  LensTags lens = {};
  std::optional<double> pixels_per_mm = std::nullopt;  // on the sensor, along x
  std::optional<GpsTags> gps = std::nullopt;
  std::optional<DroneTags> drone = std::nullopt;

  bool SwapsSides() const { return orientation >= 5; }
};

// Returns what the header of a JPEG says; values that are missing or senseless are left out.
Exif ReadExif(std::istream& file);

// Returns what a packet of XMP says, by the names of properties without their prefix; nullopt
// where it says nothing of a drone's camera or is damaged.
std::optional<DroneTags> ParseDroneTags(std::string_view xmp);

}  // namespace raylift
