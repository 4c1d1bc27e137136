// Reads priors from the tags of photographs.

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <utility>

#include "base/input_paths.h"
#include "io/text/line_tokens.h"
#include "pictures/exif.h"
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/pose_priors.h"

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// These are the standard deviations where a photograph says none, in meters along the ground and of
// the height. Barometers, geoids and ellipsoids that are taken for each other make heights that
// uncertain: a sigma that is too small costs more than one that is too large.
constexpr double kGnssSigma = 3, kPhoneSigma = 8, kHeightSigma = 20;
// No sigma with RTK is less than this, for the errors of a map's frame and of time stamps, which
// RTK's own deviations leave out.
constexpr double kLeastRtkSigma = 0.05;
// The standard deviation of a height that is not known: all of the earth's land is within this.
constexpr double kUnknownHeightSigma = 3000;
// A circle of the radius that cameras state holds two thirds of all errors, of both axes.
constexpr double kSigmaOfError = 1 / 1.5;
// Devices without RTK that state smaller errors than this are wrong.
constexpr double kLeastStatedSigma = 0.5;
// Standard deviations of gimbals' tilts and compasses; where north is magnetic, declination adds to
// them.
constexpr double kTiltSigmaDeg = 2, kGimbalHeadingSigmaDeg = 10, kHeadingSigmaDeg = 15,
                 kMagneticSigmaDeg = 25;
// Errors that makers of drones state for their lasers.
constexpr double kRangeSigma = 0.2, kRangeSigmaPerMeter = 0.0015;

Vector3d SigmaOfAcross(double across_m) {
  return {across_m, across_m, std::hypot(kHeightSigma, 2 * across_m)};
}

class Finder {
 public:
  explicit Finder(const Exif& exif) : exif_(exif) {}

  PhotographTags Find() {
    FindPosition();
    FindGimbal();
    FindHeading();
    FindRange();
    if (exif_.lens.calibration) Say("calibrated lens");
    return std::move(tags_);
  }

 private:
  void Say(const std::string& what) {
    tags_.summary += fmt::format("{}{}", tags_.summary.empty() ? "" : ", ", what);
  }

  void FindPosition() {
    if (!exif_.is_jpeg) return Say("not a JPEG: tags are not read");
    if (!exif_.gps) return Say("no GPS position");
    const GpsTags& gps = *exif_.gps;
    const double latitude = gps.latitude_deg, longitude = gps.longitude_deg;
    if (latitude == 0 && longitude == 0) return Say("GPS position of 0, 0 (no fix), not taken");
    if (std::abs(latitude) > 90 || std::abs(longitude) > 180) {
      return Say(
          fmt::format("GPS position of latitude {:g} and longitude {:g} is not on the earth, "
                      "not taken",
                      latitude, longitude));
    }
    PhotographTags::Position& position = tags_.position.emplace();
    const auto of_drone = exif_.drone ? exif_.drone->absolute_altitude_m : std::nullopt;
    const auto altitude = gps.altitude_m ? gps.altitude_m : of_drone;
    position.point = {longitude, latitude, altitude.value_or(0)};
    position.sigma_m = SigmaMeters();
    if (!altitude) position.sigma_m.z() = kUnknownHeightSigma;
    const bool is_ellipsoid = exif_.drone && exif_.drone->rtk_sigma_m;
    position.crs = !altitude ? "EPSG:4326" : is_ellipsoid ? "EPSG:4979" : "EPSG:4326+5773";
    Say(fmt::format("GPS position +-{:.2g} m{}", position.sigma_m.x(),
                    !altitude      ? ", no height"
                    : is_ellipsoid ? ", height above the ellipsoid"
                                   : ", height above the sea"));
    if (exif_.drone && exif_.drone->rtk_sigma_m) Say("RTK");
  }

  Vector3d SigmaMeters() const {
    if (exif_.drone && exif_.drone->rtk_sigma_m) {
      Vector3d sigma = exif_.drone->rtk_sigma_m->cwiseMax(kLeastRtkSigma);
      sigma.z() = std::hypot(sigma.z(), kHeightSigma);  // by what the map's heights are
      return sigma;
    }
    if (exif_.gps->horizontal_error_m) return GnssSigmaMeters(*exif_.gps->horizontal_error_m);
    return SigmaOfAcross(exif_.drone ? kGnssSigma : kPhoneSigma);
  }

  // Finds the directions of down and right in the camera and the heading, by a drone's gimbal. The
  // body's axes are forward, right and down; the level frame has them without pitch and roll.
  void FindGimbal() {
    if (!exif_.drone || !exif_.drone->pitch_deg || !exif_.drone->roll_deg) return;
    const auto turn = [](double degrees, const Vector3d& axis) {
      return Eigen::AngleAxisd(degrees * std::numbers::pi / 180, axis);
    };
    const Matrix3d level_from_body = (turn(*exif_.drone->pitch_deg, Vector3d::UnitY()) *
                                      turn(*exif_.drone->roll_deg, Vector3d::UnitX()))
                                         .toRotationMatrix();
    Matrix3d body_from_cam;
    body_from_cam << 0, 0, 1, 1, 0, 0, 0, 1, 0;
    const Matrix3d level_from_cam = level_from_body * body_from_cam;
    tags_.down_in_cam = level_from_cam.row(2);
    // A gimbal that is turned over has the image's right on its left.
    tags_.right_in_cam = level_from_cam.row(1);
    tags_.heading_deg = exif_.drone->yaw_deg;
    tags_.heading_sigma_deg = kGimbalHeadingSigmaDeg;
    Say(fmt::format("gimbal pitch {:.1f}, roll {:.1f}", *exif_.drone->pitch_deg,
                    *exif_.drone->roll_deg));
    if (tags_.heading_deg) Say(fmt::format("yaw {:.1f} deg", *tags_.heading_deg));
    if (const auto altitude_m = exif_.drone->relative_altitude_m) {
      Say(fmt::format("{:.1f} m above its start", *altitude_m));
    }
  }

  // Finds the heading of a phone, whose image may lie on its side.
  void FindHeading() {
    if (tags_.heading_deg || !exif_.gps || !exif_.gps->direction_deg) return;
    const double direction = *exif_.gps->direction_deg;
    if (!(direction >= 0 && direction <= 360)) {
      return Say(fmt::format("direction of {:g} degrees, not taken", direction));
    }
    const int orientation = exif_.orientation;
    tags_.right_in_cam = orientation <= 2   ? Vector3d(1, 0, 0)
                         : orientation <= 4 ? Vector3d(-1, 0, 0)
                         : orientation <= 6 ? Vector3d(0, -1, 0)
                                            : Vector3d(0, 1, 0);
    tags_.heading_deg = direction;
    tags_.heading_sigma_deg =
        exif_.gps->direction_is_magnetic ? kMagneticSigmaDeg : kHeadingSigmaDeg;
    Say(fmt::format("heading {:.0f} deg{}", direction,
                    exif_.gps->direction_is_magnetic ? " (magnetic)" : ""));
  }

  void FindRange() {
    if (!exif_.drone || !exif_.drone->range_m) return;
    tags_.range_m = exif_.drone->range_m;
    Say(fmt::format("laser range {:.1f} m", *tags_.range_m));
  }

  const Exif& exif_;
  PhotographTags tags_;
};

std::string Text(const Vector3d& v) {
  return fmt::format("{} {} {}", FormatDouble(v.x()), FormatDouble(v.y()), FormatDouble(v.z()));
}

}  // namespace

Eigen::Vector3d GnssSigmaMeters(double stated_error_m, bool has_height) {
  Vector3d sigma = SigmaOfAcross(std::max(kSigmaOfError * stated_error_m, kLeastStatedSigma));
  if (!has_height) sigma.z() = kUnknownHeightSigma;
  return sigma;
}

PhotographTags ReadPhotographTags(const std::filesystem::path& file) {
  RequireRegularFile(file);
  std::ifstream stream(file, std::ios::binary);
  return Finder(ReadExif(stream)).Find();
}

std::string FormatPhotographPriors(const std::string& photograph, const PhotographTags& tags) {
  const std::string name = NameText(photograph, photograph);
  std::string text;
  if (const auto& position = tags.position) {
    text += fmt::format("{} position {} {} crs={}\n", name, Text(position->point),
                        Text(position->sigma_m), position->crs);
  }
  if (tags.down_in_cam) {
    text += fmt::format("{} gravity {} {}\n", name, Text(*tags.down_in_cam), kTiltSigmaDeg);
  }
  if (tags.heading_deg) {
    text += fmt::format("{} heading {} {} {}\n", name, FormatDouble(*tags.heading_deg),
                        FormatDouble(tags.heading_sigma_deg), Text(tags.right_in_cam));
  }
  if (tags.range_m) {
    text += fmt::format("{} range {} {} m\n", name, FormatDouble(*tags.range_m),
                        FormatDouble(kRangeSigma + kRangeSigmaPerMeter * *tags.range_m));
  }
  return text;
}

}  // namespace raylift
