// Where on the earth a scene is: coordinate reference systems (CRS) and what leads from one to the
// other, by PROJ.
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

// A system and its copies are for one thread at a time.
class Crs {
 public:
  // "EPSG:25832", with a vertical one behind it "EPSG:25832+7837"; or WKT. Throws InputError for
  // what is unknown or places no points on the earth.
  explicit Crs(const std::string& definition);

  const std::string& definition() const { return definition_; }
  const std::string& name() const { return name_; }  // "WGS 84 / UTM zone 32N"
  CrsKind kind() const { return kind_; }
  // Heights are above an ellipsoid or of a vertical datum; else they are what they are.
  bool has_heights() const { return has_heights_; }

  // Throws InputError where the point is not on the earth (latitudes beyond the poles), or far from
  // where the system is meant for; it says so where its axes seem to be swapped.
  void Check(const Eigen::Vector3d& point) const;

  struct Geographic;  // the way to longitude and latitude
  const Geographic& geographic() const { return *geographic_; }

 private:
  bool Holds(const Eigen::Vector3d& point) const;

  std::string definition_, name_;
  CrsKind kind_ = CrsKind::kProjected;
  bool has_heights_ = false;
  // Degrees, where the system is meant for; west may be above east.
  struct Area {
    double west, south, east, north;
  };
  std::optional<Area> area_;
  std::shared_ptr<const Geographic> geographic_;
};

// Returns whether the authority has northings before eastings, which coordinates as drawn on a map
// do not follow.
bool NorthingsComeFirst(const Crs& crs);

// The frame of a scene: a system, and the point of it that is the world's origin.
struct WorldFrame {
  std::string text;  // that it was parsed from, in one line
  Crs crs;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  // Nobody has said it, it is that of a mesh's file: who says another one knows better.
  bool is_of_file = false;

  // "EPSG:32615", or with an origin that was taken off all coordinates,
  // "EPSG:32615@576000,5188000,0". Throws InputError, for systems of degrees, too.
  static WorldFrame Parse(const std::string& given);
};

// Leads points from one system to another. Of a height no more than the unit changes where the
// target has no heights; where the source alone has none, it is above the ellipsoid. To and from
// earth-centered coordinates it always is. A transform and its copies are for one thread at a time.
class CrsTransform {
 public:
  // Throws InputError where nothing leads there.
  CrsTransform(const Crs& from, const Crs& to);

  // Throws InputError where the point has no place in the system that it is led to.
  Eigen::Vector3d operator()(const Eigen::Vector3d& point) const;

  // Says which grids are missing that a better transformation would use, or that heights or datums
  // are taken as they are; nullopt where all is well.
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

  // The nearest rotation: of directions.
  Eigen::Matrix3d Axes() const;
  // Of the map: units per meter along the ground.
  double Scale() const;
};
LocalFrame LocalFrameAt(const Crs& crs, const Eigen::Vector3d& point);

}  // namespace raylift
