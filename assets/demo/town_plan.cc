#include "town_plan.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Geometry>

namespace raylift::demo {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Kind = CityPolygon::Kind;
using Roof = House::Roof;

constexpr double kGroundCell = 2.5;

House DrawHouse(Rng& rng) {
  House house{};
  const double kind = rng.Uniform();
  house.roof = kind < 0.5 ? Roof::kGabled : kind < 0.8 ? Roof::kHipped : Roof::kFlat;
  const int storeys = 1 + static_cast<int>(rng.UniformIndex(3));
  house.wall_m = 2.9 * storeys + 0.5 + rng.Uniform(0, 0.4);
  house.width_m = rng.Uniform(7.5, 9.5);
  house.length_m = house.width_m + rng.Uniform(1.5, 5);
  house.front = house.roof == Roof::kGabled && rng.Uniform() < 0.4 ? 1 : 0;
  if (house.roof == Roof::kFlat) {
    if (rng.Uniform() < 0.5) {
      house.width_m += 2.5;
      house.well = Rect{0.35 * house.length_m, 0.36 * house.width_m, 0.62 * house.length_m,
                        0.66 * house.width_m};
    }
  } else {
    house.rise_m = 0.5 * house.width_m * rng.Uniform(0.75, 1.15);
  }
  return house;
}

std::vector<Vector2d> Corners(const House& house) {
  std::vector<Vector2d> corners;
  for (int side = 0; side < 4; ++side) corners.push_back(house.Wall(side).origin.head<2>());
  return corners;
}

// The walls of an upright ring between two heights, seen from its right as it runs.
void AddWalls(const std::vector<Vector3d>& ring, double low, std::vector<CityPolygon>& solid) {
  for (size_t i = 0; i < ring.size(); ++i) {
    const Vector3d& a = ring[i];
    const Vector3d& b = ring[(i + 1) % ring.size()];
    solid.push_back({Kind::kWall, {{{a.x(), a.y(), low}, {b.x(), b.y(), low}, b, a}}});
  }
}

std::vector<Vector3d> Ring(double x0, double y0, double x1, double y1, double z) {
  return {{x0, y0, z}, {x1, y0, z}, {x1, y1, z}, {x0, y1, z}};
}

std::vector<Vector3d> Reversed(std::vector<Vector3d> ring) {
  std::reverse(ring.begin(), ring.end());
  return ring;
}

// All in the house's frame.
std::vector<CityPolygon> Block(const House& house, double top) {
  const auto outline = Ring(0, 0, house.length_m, house.width_m, top);
  std::vector<CityPolygon> solid;
  CityPolygon roof{Kind::kRoof, {outline}};
  CityPolygon ground{Kind::kGround,
                     {Reversed(Ring(0, 0, house.length_m, house.width_m, -house.foot_m))}};
  AddWalls(outline, -house.foot_m, solid);
  if (house.well) {
    const Rect& w = *house.well;
    const auto hole = Reversed(Ring(w.x0, w.y0, w.x1, w.y1, top));
    AddWalls(hole, -house.foot_m, solid);
    roof.rings.push_back(hole);
    ground.rings.push_back(Ring(w.x0, w.y0, w.x1, w.y1, -house.foot_m));
  }
  solid.push_back(std::move(roof));
  solid.push_back(std::move(ground));
  return solid;
}

std::vector<CityPolygon> Roofed(const House& house) {
  const double l = house.length_m, w = house.width_m, eaves = house.wall_m;
  const double hip = house.roof == Roof::kHipped ? 0.5 * w : 0;
  const Vector3d west(hip, 0.5 * w, eaves + house.rise_m);
  const Vector3d east(l - hip, 0.5 * w, eaves + house.rise_m);
  const auto e = Ring(0, 0, l, w, eaves);
  std::vector<CityPolygon> solid;
  AddWalls(e, -house.foot_m, solid);
  solid.push_back({Kind::kGround, {Reversed(Ring(0, 0, l, w, -house.foot_m))}});
  solid.push_back({Kind::kRoof, {{e[0], e[1], east, west}}});
  solid.push_back({Kind::kRoof, {{e[2], e[3], west, east}}});
  if (house.roof == Roof::kHipped) {
    solid.push_back({Kind::kRoof, {{e[1], e[2], east}}});
    solid.push_back({Kind::kRoof, {{e[3], e[0], west}}});
  } else {
    for (const auto& [side, ridge] : {std::pair{1, east}, std::pair{3, west}}) {
      std::vector<Vector3d>& gable = solid[static_cast<size_t>(side)].rings[0];
      gable.insert(gable.begin() + 3, ridge);
    }
  }
  return solid;
}

}  // namespace

Frame House::Wall(int side) const {
  const std::array<Vector3d, 4> corners{frame.origin, frame.At(length_m, 0, 0),
                                        frame.At(length_m, width_m, 0), frame.At(0, width_m, 0)};
  const Vector3d& corner = corners[static_cast<size_t>(side)];
  const Vector3d x = (corners[static_cast<size_t>(side + 1) % 4] - corner).normalized();
  return {corner, x, frame.z, x.cross(frame.z)};
}

bool House::Holds(const Vector2d& place, double margin_m) const {
  const Vector2d offset = place - frame.origin.head<2>();
  const double x = offset.dot(frame.x.head<2>()), y = offset.dot(frame.y.head<2>());
  return x > -margin_m && x < length_m + margin_m && y > -margin_m && y < width_m + margin_m;
}

Town::Town(uint64_t seed) {
  Rng rng(StreamSeed(seed, "town", "plan"));
  phase_ = rng.Uniform(0, 6);
  for (int street = 0; street < kStreets; ++street) BuildAlong(street, rng);
}

double Town::GroundZ(double x, double y) const {
  x = std::clamp(x, 0.0, kWidth);
  y = std::clamp(y, 0.0, kDepth);
  return 24 + 0.022 * x - 0.012 * y + 1.5 * std::sin(x / 34 + phase_) * std::cos(y / 29 - phase_);
}

std::vector<std::array<Vector3d, 3>> Town::Ground() const {
  std::vector<std::array<Vector3d, 3>> triangles;
  for (double x = 0; x < kWidth; x += kGroundCell) {
    for (double y = 0; y < kDepth; y += kGroundCell) {
      const Vector3d a = OnGround(x, y), c = OnGround(x + kGroundCell, y + kGroundCell);
      triangles.push_back({a, OnGround(x + kGroundCell, y), c});
      triangles.push_back({a, c, OnGround(x, y + kGroundCell)});
    }
  }
  return triangles;
}

Town::Place Town::OnStreet(int street, double along_m) const {
  const auto sway = [&](double amplitude, double period, double& slope) {
    slope = amplitude / period * std::cos(along_m / period + phase_);
    return amplitude * std::sin(along_m / period + phase_);
  };
  double slope = 0;
  if (street == 0) {
    const double x = 82 + sway(3, 24, slope);
    return {{x, along_m}, Vector2d(slope, 1).normalized()};
  }
  const double y = street == 1 ? 40 + sway(4, 28, slope) : 101 + sway(-4, 33, slope);
  return {{along_m, y}, Vector2d(1, slope).normalized()};
}

double Town::DistanceToStreet(double x, double y) const {
  double distance = std::numeric_limits<double>::infinity();
  for (int street = 0; street < kStreets; ++street) {
    const Place place = OnStreet(street, street == 0 ? y : x);
    const Vector2d right(place.along.y(), -place.along.x());
    distance = std::min(distance, std::abs(right.dot(Vector2d(x, y) - place.at)));
  }
  return distance;
}

bool Town::IsFree(const Vector2d& place, double margin_m) const {
  return std::none_of(houses_.begin(), houses_.end(),
                      [&](const House& house) { return house.Holds(place, margin_m); });
}

// Houses on both sides of a street, with their fronts to it, where there is room.
void Town::BuildAlong(int street, Rng& rng) {
  constexpr double kLeastGap = 1.6;
  for (const double sign : {-1.0, 1.0}) {
    for (double along = rng.Uniform(4, 8); along < StreetLength(street) - 16;) {
      House house = DrawHouse(rng);
      const double front_m = house.SideLength(house.front);
      const Place place = OnStreet(street, along + 0.5 * front_m);
      // As one looks from the street to the house: right, and away.
      const Vector2d away = sign * Vector2d(place.along.y(), -place.along.x());
      const Vector2d right(away.y(), -away.x());
      const double set_back = kStreetHalfWidth + kPavement + rng.Uniform(0.8, 4);
      const Vector2d corner = place.at + set_back * away - 0.5 * front_m * right;
      house.frame.x = {right.x(), right.y(), 0};
      house.frame.y = {away.x(), away.y(), 0};
      house.frame.origin = {corner.x(), corner.y(), 0};
      if (house.front == 1) {
        house.frame = {house.frame.At(0, house.length_m, 0), -house.frame.y, house.frame.x,
                       Vector3d::UnitZ()};
      }
      const double gap = rng.Uniform() < 0.3 ? kLeastGap + 0.1 : rng.Uniform(2.5, 7);
      along += front_m + gap;
      bool fits = true;
      const auto corners = Corners(house);
      for (double s = 0; s < 1; s += 0.125) {
        for (size_t i = 0; i < 4; ++i) {
          const Vector2d edge = (1 - s) * corners[i] + s * corners[(i + 1) % 4];
          fits &= edge.x() > 3 && edge.y() > 3 && edge.x() < kWidth - 3 && edge.y() < kDepth - 3 &&
                  DistanceToStreet(edge.x(), edge.y()) > kStreetHalfWidth + kPavement + 0.5 &&
                  IsFree(edge, kLeastGap);
        }
      }
      if (!fits) continue;
      const Frame front = house.Wall(house.front);
      double lowest = std::numeric_limits<double>::infinity();
      for (const Vector2d& at : corners) lowest = std::min(lowest, GroundZ(at.x(), at.y()));
      const Vector3d left = front.At(0, 0, 0), end = front.At(front_m, 0, 0);
      const double floor = std::max(GroundZ(left.x(), left.y()), GroundZ(end.x(), end.y())) + 0.12;
      house.frame.origin.z() = floor;
      house.foot_m = floor - lowest + 0.4;
      houses_.push_back(house);
    }
  }
}

std::vector<CityPolygon> SolidOf(const House& house, LevelOfDetail level) {
  const bool is_block = level == LevelOfDetail::kLod1 || house.roof == Roof::kFlat;
  std::vector<CityPolygon> solid =
      is_block ? Block(house, house.wall_m + 0.5 * house.rise_m) : Roofed(house);
  for (CityPolygon& polygon : solid) {
    for (auto& ring : polygon.rings) {
      for (Vector3d& p : ring) p = house.frame.At(p.x(), p.y(), p.z());
    }
  }
  return solid;
}

}  // namespace raylift::demo
