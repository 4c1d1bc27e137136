// The plan of the made town, without anything painted: its ground, its streets, and its houses as
// the simple solids that a city model has of them.
// Town frame: meters, z up, x to the east, y to the north; its origin lies in kTownCrs.

#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "canvas.h"
#include "mesh_builder.h"

namespace raylift::demo {

constexpr const char* kTownCrs = "EPSG:25832";
const Eigen::Vector3d kTownOrigin{566000, 5935000, 0};

// A rectangular house. Its frame: x along the ridge, y across it, z up; the origin is the corner
// at the ground floor's level. Side 0 is y = 0, the others follow counter-clockwise.
struct House {
  enum class Roof { kGabled, kHipped, kFlat };

  Frame frame;
  double length_m, width_m;  // along x and y
  double wall_m;             // from the ground floor to the eaves
  double rise_m;             // from the eaves to the ridge
  double foot_m;             // from the ground floor down to where the walls end
  Roof roof;
  int front;                 // the side to the street: 0 or 1
  std::optional<Rect> well;  // a light well in a flat house

  double slope() const { return rise_m / (0.5 * width_m); }
  double SideLength(int side) const { return side % 2 == 0 ? length_m : width_m; }
  // The frame of a facade: x to the right as seen from outside, y up, z out of the wall.
  Frame Wall(int side) const;
  bool Holds(const Eigen::Vector2d& place, double margin_m) const;
};

class Town {
 public:
  static constexpr double kWidth = 170, kDepth = 140;
  static constexpr double kStreetHalfWidth = 3.2, kPavement = 1.8;

  explicit Town(uint64_t seed);

  const std::vector<House>& houses() const { return houses_; }
  double GroundZ(double x, double y) const;
  // The ground in triangles, as the map has it.
  std::vector<std::array<Eigen::Vector3d, 3>> Ground() const;
  Eigen::Vector3d OnGround(double x, double y) const { return {x, y, GroundZ(x, y)}; }

  // Where a street's middle is, at a number of meters along it, and where it leads.
  struct Place {
    Eigen::Vector2d at, along;
  };
  static constexpr int kStreets = 3;
  static double StreetLength(int street) { return street == 0 ? kDepth : kWidth; }
  Place OnStreet(int street, double along_m) const;
  // To the middle of the nearest street, nearly.
  double DistanceToStreet(double x, double y) const;
  bool IsFree(const Eigen::Vector2d& place, double margin_m) const;

 private:
  void BuildAlong(int street, Rng& rng);

  double phase_;
  std::vector<House> houses_;
};

// A polygon of a city model: the outer ring, counter-clockwise as seen from outside, then its
// holes.
struct CityPolygon {
  enum class Kind { kGround, kWall, kRoof };
  Kind kind;
  std::vector<std::vector<Eigen::Vector3d>> rings;
};

// The house's closed solid: a block (LoD1), or with its roof's shape (LoD2).
enum class LevelOfDetail { kLod1, kLod2 };
std::vector<CityPolygon> SolidOf(const House& house, LevelOfDetail level);

}  // namespace raylift::demo
