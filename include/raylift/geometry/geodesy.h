// The place of a scene on the earth: coordinate reference systems (CRS) and transforms between
// them, by PROJ.
//
// A point is (x, y, z) as drawn on a map, whatever order the authority has for its axes: easting,
// northing and height in the units of the system; longitude, latitude in its degrees and height
// where it is geographic; X, Y, Z in meters where it is earth-centered. A map without heights of
// its own has them in the unit of its eastings.

#pragma once

#include <memory>
#include <optional>
#include <string>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace raylift {

enum class CrsKind { kGeographic, kProjected, kGeocentric };

// A system and its copies must be used by one thread at a time.
class Crs {
 public:
  // Parses "EPSG:25832", with a vertical system "EPSG:25832+7837"; or WKT. Throws InputError for
  // what is unknown or places no points on the earth.
  explicit Crs(const std::string& definition);

  const std::string& definition() const { return definition_; }
  const std::string& name() const { return name_; }  // "WGS 84 / UTM zone 32N"
  CrsKind kind() const { return kind_; }
  // Returns whether the system defines its heights: above an ellipsoid or of a vertical datum.
  bool has_heights() const { return has_heights_; }

  // Throws InputError where the point is not on the earth (latitudes beyond the poles) or far
  // outside the system's area of use; the message says so where the axes seem to be swapped.
  void Check(const Eigen::Vector3d& point) const;

  struct Geographic;  // the way to longitude and latitude
  const Geographic& geographic() const { return *geographic_; }

 private:
  bool Holds(const Eigen::Vector3d& point) const;

  std::string definition_, name_;
  CrsKind kind_ = CrsKind::kProjected;
  bool has_heights_ = false;
  // The system's area of use, in degrees; west may be larger than east.
  struct Area {
    double west, south, east, north;
  };
  std::optional<Area> area_;
  std::shared_ptr<const Geographic> geographic_;
};

// Returns whether the authority has northings before eastings, which coordinates as drawn on a map
// do not follow.
bool NorthingsComeFirst(const Crs& crs);

// The frame of a scene: a system, and its point that is the world's origin.
struct WorldFrame {
  std::string text;  // that it was parsed from, in one line
  Crs crs;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  // The frame was read from a mesh's file; another one that the user gives takes precedence.
  bool is_of_file = false;

  // Parses "EPSG:32615", or with an origin that was subtracted from all coordinates,
  // "EPSG:32615@576000,5188000,0". Throws InputError, also for systems in degrees.
  static WorldFrame Parse(const std::string& given);
};

// Transforms points from one system to another. Where the target has no heights, only the unit of a
// height changes; where the source alone has none, heights are above the ellipsoid, as they always
// are to and from earth-centered coordinates. A transform and its copies must be used by one thread
// at a time.
class CrsTransform {
 public:
  // Throws InputError where no transform is known.
  CrsTransform(const Crs& from, const Crs& to);

  // Transforms a point. Throws InputError where it has no place in the target system.
  Eigen::Vector3d operator()(const Eigen::Vector3d& point) const;

  // Says which missing grids a better transformation would use, or that heights or datums are taken
  // as they are; nullopt where there is nothing to say.
  std::optional<std::string> Warning() const;

 private:
  struct Operation;
  std::string from_, to_;
  std::shared_ptr<Operation> operation_;
};

// The directions east, north and up at a point, in the coordinates of a system.
struct LocalFrame {
  Eigen::Vector3d geographic;  // longitude from Greenwich, latitude in degrees, height in meters
  // Units of the system per meter: columns are east, north, up. On a map of true scale, north along
  // its y axis, it is the identity.
  Eigen::Matrix3d crs_from_enu;

  // Returns the nearest rotation, for directions.
  Eigen::Matrix3d Axes() const;
  // Returns the map's scale: its units per meter along the ground.
  double Scale() const;
};
LocalFrame LocalFrameAt(const Crs& crs, const Eigen::Vector3d& point);

}  // namespace raylift
