// The place of a served scene on the earth.

#pragma once

#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "localization/results/earth_exports.h"
#include <Eigen/Core>

#include "raylift/geometry/geodesy.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// A position on the earth as clients know it: by GNSS, or by an earlier answer.
struct RoughPosition {
  Eigen::Vector3d geographic;  // longitude, latitude in degrees, height of WGS 84
  // Standard deviations in meters along east, north and up; nullopt where the position only tells
  // which scene is near.
  std::optional<Eigen::Vector3d> sigma_m = std::nullopt;
};

// Converts between the served scene and the earth; any thread may call its functions.
class ScenePlace {
 public:
  // Throws InputError where the references lie outside of the area of use of the world's coordinate
  // system.
  ScenePlace(const WorldFrame& world, const ReferenceSet& references);

  struct Camera {
    std::string geopose;                          // OGC GeoPose 1.0, Basic-Quaternion, as JSON
    std::optional<Eigen::Vector3d> sigma_m = {};  // of its center, along east, north and up
  };
  // Returns the camera's place on the earth; nullopt outside of that area of use.
  std::optional<Camera> CameraOf(const PoseEstimate& estimate) const;

  // Returns the distance to the nearest reference along the ground, in meters; nullopt where the
  // position lies outside of that area of use.
  std::optional<double> DistanceMeters(const RoughPosition& position) const;

  // Returns the position as a prior in the world; nullopt likewise, and without `sigma_m`.
  std::optional<PositionPrior> PriorOf(const RoughPosition& position) const;

  // Returns a warning that says how places may be off; nullopt where they are not.
  std::optional<std::string> Warning() const;

 private:
  struct Place {
    Eigen::Vector3d in_crs;
    Eigen::Matrix3d crs_from_enu;  // LocalFrame::crs_from_enu
  };
  // Returns nullopt outside of the coordinate system's area of use.
  std::optional<Place> PlaceAt(const Eigen::Vector3d& geographic) const;

  mutable std::mutex mutex_;  // PROJ's objects are for one thread at a time
  EarthFrame earth_;
  Crs wgs84_;
  CrsTransform to_crs_;
  std::vector<Eigen::Vector3d> references_in_crs_;
};

}  // namespace raylift
