#include "surfaces.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "noise.h"

namespace raylift::demo {

namespace {

// 1 in the joint, 0 on the stone, for a distance to the joint's middle.
double Joint(double distance, double half_width) {
  return std::clamp(1.5 - distance / half_width, 0.0, 1.0);
}

double DistanceToMultiple(double value, double period) {
  return std::abs(value - period * std::round(value / period));
}

}  // namespace

Color Brick(double x, double y, const Color& base, uint32_t seed) {
  constexpr double kLength = 0.25, kCourse = 0.083;
  const int row = static_cast<int>(std::floor(y / kCourse));
  const double shifted = x + (row % 2 == 0 ? 0 : 0.5 * kLength);
  const int column = static_cast<int>(std::floor(shifted / kLength));
  const double tone = Hash(column, row, seed);
  const Color brick = Mix(Mix(base, {0.32f, 0.17f, 0.14f}, 0.75 * tone * tone),
                          {0.80f, 0.56f, 0.42f}, 0.5 * Hash(column, row, seed + 9) - 0.2);
  const Color mortar = Lit({0.70f, 0.66f, 0.60f}, 0.8 + 0.3 * Noise(9 * x, 9 * y, seed + 1));
  const double joint = std::max(Joint(DistanceToMultiple(shifted, kLength), 0.007),
                                Joint(DistanceToMultiple(y, kCourse), 0.007));
  const double wear = 0.84 + 0.3 * FractalNoise(24 * x, 24 * y, 2, seed + 2);
  return Mix(Lit(brick, wear), mortar, joint);
}

Color Plaster(double x, double y, const Color& base, uint32_t seed) {
  const double clouds = FractalNoise(0.7 * x, 0.7 * y, 4, seed);
  const double grain = FractalNoise(14 * x, 14 * y, 3, seed + 10);
  Color color = Lit(base, 0.72 + 0.28 * clouds + 0.28 * grain);
  // Trowel marks and flecks of grit.
  const double marks = FractalNoise(5 * x + 2 * y, 7 * y - x, 2, seed + 15);
  color = Lit(color, marks > 0.64 ? 0.90 : marks < 0.34 ? 1.08 : 1);
  const Cell fleck = CellNoise(9 * x, 9 * y, seed + 16);
  if (fleck.id > 0.84 && fleck.edge_distance > 0.5)
    color = Lit(color, fleck.id > 0.92 ? 0.80 : 1.12);
  // Hairline cracks along the zero line of a noise, and patches where the coat has come off.
  const double crack = std::abs(FractalNoise(1.1 * x, 1.1 * y, 4, seed + 20) - 0.5);
  if (crack < 0.004 && Noise(0.8 * x, 0.8 * y, seed + 21) > 0.5) color = Lit(color, 0.62);
  const double patch = FractalNoise(0.9 * x, 0.9 * y, 4, seed + 30);
  if (patch > 0.665) {
    color = Brick(x, y, {0.62f, 0.36f, 0.27f}, seed + 31);
  } else if (patch > 0.652) {
    color = Lit(color, 0.72);
  }
  return color;
}

Color Ashlar(double x, double y, const Color& base, double course_m, uint32_t seed) {
  const int row = static_cast<int>(std::floor(y / course_m));
  const double length = course_m * (1.5 + 0.9 * Hash(row, 0, seed));
  const double shifted = x + length * Hash(row, 1, seed);
  const int column = static_cast<int>(std::floor(shifted / length));
  const double tone = 0.80 + 0.28 * Hash(column, row, seed + 2);
  const double joint = std::max(Joint(DistanceToMultiple(shifted, length), 0.008),
                                Joint(DistanceToMultiple(y, course_m), 0.008));
  return Mix(RoughStone(x, y, Lit(base, tone), seed + 3), Lit(base, 0.45), joint);
}

Color RoughStone(double x, double y, const Color& base, uint32_t seed) {
  const double clouds = FractalNoise(2.2 * x, 2.2 * y, 3, seed);
  const double grain = FractalNoise(20 * x, 20 * y, 3, seed + 5);
  const Color color = Lit(base, 0.66 + 0.32 * clouds + 0.34 * grain);
  return Mix(color, {0.33f, 0.36f, 0.27f}, 2.2 * (FractalNoise(3 * x, 3 * y, 4, seed + 8) - 0.6));
}

Color Planks(double x, double y, const Color& base, double plank_m, uint32_t seed) {
  const int plank = static_cast<int>(std::floor(x / plank_m));
  const double offset = 13.7 * Hash(plank, 0, seed);
  const double rings =
      FractalNoise(38 * x + 3 * Noise(3 * y, plank, seed), 1.6 * y + offset, 3, seed + 1);
  const double knot_y = 0.9 * Hash(plank, 1, seed) + std::floor(y / 0.9) * 0.9;
  const double knot = std::hypot((x - (plank + 0.5) * plank_m) / 0.018, (y - knot_y) / 0.03);
  Color color = Lit(base, (0.74 + 0.3 * Hash(plank, 2, seed)) * (0.66 + 0.62 * rings));
  color = Mix(color, Lit(base, 0.35), 0.8 * std::clamp(1.3 - knot, 0.0, 1.0));
  return Mix(color, Lit(base, 0.25), Joint(DistanceToMultiple(x, plank_m), 0.006));
}

Color Cobbles(double x, double y, const Color& base, double stone_m, uint32_t seed) {
  const Cell cell = CellNoise(x / stone_m, y / stone_m, seed);
  const Color stone = Mix(Lit(base, 0.68 + 0.5 * cell.id), Color(0.60f, 0.50f, 0.42f),
                          0.8 * std::fmod(cell.id * 7.31, 1.0) - 0.3);
  const double dome = 0.86 + 0.2 * std::min(1.0, 2 * cell.edge_distance);
  const double grain = 0.82 + 0.36 * FractalNoise(22 * x, 22 * y, 2, seed + 4);
  return Mix(Lit(stone, dome * grain), {0.21f, 0.20f, 0.17f}, Joint(cell.edge_distance, 0.09));
}

Color Flagstones(double x, double y, const Color& base, double slab_m, uint32_t seed) {
  const int row = static_cast<int>(std::floor(y / slab_m));
  const double length = slab_m * (1.1 + 0.6 * Hash(row, 3, seed));
  const double shifted = x + length * Hash(row, 4, seed);
  const int column = static_cast<int>(std::floor(shifted / length));
  const double joint = std::max(Joint(DistanceToMultiple(shifted, length), 0.010),
                                Joint(DistanceToMultiple(y, slab_m), 0.010));
  const Color slab = Lit(base, 0.76 + 0.34 * Hash(column, row, seed));
  return Mix(RoughStone(x, y, slab, seed + 6), {0.26f, 0.26f, 0.20f}, joint);
}

Color RoofTiles(double x, double y, uint32_t seed) {
  constexpr double kWidth = 0.24, kCourse = 0.30;
  const int row = static_cast<int>(std::floor(y / kCourse));
  const double shifted = x + (row % 2 == 0 ? 0 : 0.5 * kWidth);
  const int column = static_cast<int>(std::floor(shifted / kWidth));
  const double across = shifted / kWidth - column, along = y / kCourse - row;
  const double bend = 0.62 + 0.42 * std::sin(std::numbers::pi * across);
  const double overlap = along < 0.12 ? 0.5 : 1;
  const Color tile = Mix({0.66f, 0.33f, 0.22f}, {0.40f, 0.25f, 0.21f}, Hash(column, row, seed));
  const double moss = 2.5 * (FractalNoise(1.3 * x, 1.3 * y, 3, seed + 1) - 0.55);
  return Lit(Mix(tile, {0.36f, 0.38f, 0.22f}, moss), bend * overlap);
}

Color Metal(double x, double y, const Color& base, uint32_t seed) {
  const double rust = 3 * (FractalNoise(4 * x, 4 * y, 4, seed) - 0.56);
  const Color painted = Lit(base, 0.85 + 0.3 * FractalNoise(30 * x, 30 * y, 2, seed + 1));
  return Mix(painted, {0.42f, 0.24f, 0.14f}, rust);
}

Color Foliage(double x, double y, const Color& base, uint32_t seed) {
  const Cell leaf = CellNoise(16 * x, 16 * y, seed);
  const Color color = Mix(Lit(base, 0.5 + 0.9 * leaf.id), {0.62f, 0.66f, 0.20f},
                          0.6 * std::fmod(leaf.id * 5.7, 1.0) - 0.2);
  return Lit(color, 0.45 + 0.75 * std::min(1.0, 3 * leaf.edge_distance));
}

Color Water(double x, double y, uint32_t seed) {
  const double ripple = FractalNoise(5 * x, 5 * y, 4, seed);
  const double glint = std::pow(FractalNoise(9 * x, 9 * y, 2, seed + 5), 4);
  return Mix({0.13f, 0.27f, 0.29f}, {0.36f, 0.52f, 0.54f}, ripple) +
         Color::Constant(static_cast<float>(0.5 * glint));
}

Color Cloth(double x, double y, const Color& base, uint32_t seed) {
  const double weave = 0.94 + 0.12 * Noise(90 * x, 90 * y, seed);
  return Lit(base, weave * (0.80 + 0.36 * FractalNoise(2.5 * x, 1.2 * y, 3, seed + 1)));
}

Color Bark(double x, double y, uint32_t seed) {
  const double ridges = FractalNoise(16 * x, 3.5 * y, 4, seed);
  return Mix({0.20f, 0.16f, 0.12f}, {0.55f, 0.47f, 0.38f}, 1.8 * (ridges - 0.25));
}

}  // namespace raylift::demo
