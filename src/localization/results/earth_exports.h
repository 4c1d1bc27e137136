// Exports poses and points of a scene whose place on the earth is known, for maps and AR.

#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <nlohmann/json_fwd.hpp>

#include "raylift/geometry/geodesy.h"
#include "raylift/localization/localizer.h"

namespace raylift {

// Leads what is known in the world to longitude, latitude and height of WGS 84 and the directions
// east, north and up there.
class EarthFrame {
 public:
  explicit EarthFrame(const WorldFrame& world)
      : world_(world), to_wgs84_(world.crs, Crs("EPSG:4979")) {}

  struct Place {
    Eigen::Vector3d geographic;      // longitude, latitude in degrees, height in meters
    Eigen::Matrix3d world_from_enu;  // a rotation
    double units_per_meter = 1;      // of the map, along the ground
  };
  // Throws InputError where the world's system is not meant for the point.
  Place At(const Eigen::Vector3d& point_in_world) const;

  const WorldFrame& world() const { return world_; }
  // Says how the last place may be off, nullopt where it is not.
  std::optional<std::string> Warning() const { return to_wgs84_.Warning(); }
  // Says that heights are taken as they are; nullopt where the world's system has heights.
  std::optional<std::string> HeightsWarning() const;

 private:
  WorldFrame world_;
  CrsTransform to_wgs84_;
};

// Returns the covariance of the camera's center in the world; nullopt where it is not known.
std::optional<Eigen::Matrix3d> CenterCovariance(const PoseEstimate& estimate);

// Returns that covariance in square meters along east, north and up at the camera's place.
std::optional<Eigen::Matrix3d> CenterCovarianceEnu(const PoseEstimate& estimate,
                                                   const EarthFrame::Place& place);

// Returns OGC GeoPose 1.0, as Basic-Quaternion or as Basic-YPR. The frame of the pose is the
// camera's body: x is where it looks, y the left and z the top of its image; without rotation they
// are east, north and up.
enum class GeoPoseForm { kQuaternion, kYawPitchRoll };
nlohmann::ordered_json GeoPoseOf(const Rigid3& cam_from_world, const EarthFrame::Place& place,
                                 GeoPoseForm form = GeoPoseForm::kQuaternion);

// Writes one file per query below a folder.
void WriteGeoPoses(const std::filesystem::path& folder, const EarthFrame& earth,
                   std::span<const LocalizedQuery> queries, GeoPoseForm form);

// Writes GeoJSON (RFC 7946): a point for each query with its verdict, confidence and standard
// deviations, and the ellipse on the ground that holds it with 95 %.
void WriteGeoJson(const std::filesystem::path& file, const EarthFrame& earth,
                  std::span<const LocalizedQuery> queries);

// Writes lines `name qw qx qy qz E N H`: the rotation from the axes of photogrammetry's cameras
// (x right, y the top of the image, z against where it looks; as of Pix4D) to those of another
// system, and the camera's center in it.
void WriteMapPoses(const std::filesystem::path& file, const EarthFrame& earth, const Crs& target,
                   std::span<const LocalizedQuery> queries);

}  // namespace raylift
