#include "town_sheets.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "noise.h"
#include "panes.h"
#include "sheets.h"
#include "surfaces.h"

#include "raylift/base/parallel.h"

namespace raylift::demo {

namespace {

using Wall = HouseStyle::Wall;

Color DrawColor(Rng& rng, const std::vector<Color>& colors) {
  const Color& color = colors[rng.UniformIndex(static_cast<uint32_t>(colors.size()))];
  return color + 0.07f * Color(static_cast<float>(rng.Uniform(-1, 1)),
                               static_cast<float>(rng.Uniform(-1, 1)),
                               static_cast<float>(rng.Uniform(-1, 1)));
}

Color Grass(double x, double y, uint32_t seed) {
  const double blades = FractalNoise(5 * x, 5 * y, 3, seed);
  const double patches = FractalNoise(0.25 * x, 0.25 * y, 4, seed + 1);
  const Color color = Mix({0.30f, 0.40f, 0.17f}, {0.52f, 0.53f, 0.27f}, 2.4 * (patches - 0.3));
  const Cell clover = CellNoise(1.1 * x, 1.1 * y, seed + 2);
  return Lit(color, (0.6 + 0.8 * blades) * (clover.id > 0.8 ? 0.8 : 1));
}

Color Asphalt(double x, double y, uint32_t seed) {
  double shade = 0.30 + 0.16 * FractalNoise(0.5 * x, 0.5 * y, 5, seed) +
                 0.08 * FractalNoise(9 * x, 9 * y, 2, seed + 1);
  // Where it was mended, and where it has cracked.
  const Cell patch = CellNoise(0.16 * x, 0.3 * y, seed + 2);
  if (patch.id > 0.7) shade *= patch.edge_distance < 0.03 ? 0.5 : 0.8;
  if (std::abs(FractalNoise(0.35 * x, 0.35 * y, 4, seed + 3) - 0.5) < 0.004) shade *= 0.6;
  return Lit({0.98f, 0.98f, 1.0f}, shade);
}

// Panels of the sun's light on a roof, or windows in it.
void PaintPanels(Canvas& canvas, const Rect& area) {
  canvas.Fill(area, {0.72f, 0.72f, 0.72f});
  const int columns = std::max(1, static_cast<int>(area.width() / 1.05));
  const int rows = std::max(1, static_cast<int>(area.height() / 1.7));
  for (int i = 0; i < columns * rows; ++i) {
    const double w = area.width() / columns, h = area.height() / rows;
    const double x = area.x0 + w * (i % columns), y = area.y0 + h * static_cast<int>(i / columns);
    canvas.Paint(
        {x + 0.03, y + 0.03, x + w - 0.03, y + h - 0.03}, [&](double px, double py, Color& texel) {
          const bool is_line = std::fmod(px - x, 0.17) < 0.02 || std::fmod(py - y, 0.17) < 0.02;
          texel = is_line ? Color(0.20f, 0.24f, 0.33f) : Color(0.07f, 0.10f, 0.20f);
        });
  }
}

bool IsOnPath(const House& house, double x, double y) {
  const Frame front = house.Wall(house.front);
  const Eigen::Vector2d offset = Eigen::Vector2d(x, y) - front.origin.head<2>();
  const double right = offset.dot(front.x.head<2>()), out = offset.dot(front.z.head<2>());
  const double door = 0.5 * house.SideLength(house.front);
  return out > -0.3 && out < 6 && std::abs(right - door) < 0.8;
}

Color GroundColor(const Town& town, const std::vector<const House*>& near, double x, double y) {
  const double street = town.DistanceToStreet(x, y);
  if (street < Town::kStreetHalfWidth) return Asphalt(x, y, 701);
  if (street < Town::kStreetHalfWidth + 0.16) return RoughStone(x, y, {0.70f, 0.69f, 0.66f}, 702);
  if (street < Town::kStreetHalfWidth + Town::kPavement) {
    return Flagstones(x, y, {0.66f, 0.63f, 0.59f}, 0.5, 703);
  }
  for (const House* house : near) {
    if (IsOnPath(*house, x, y)) return Cobbles(x, y, {0.58f, 0.50f, 0.44f}, 0.25, 704);
    if (house->Holds({x, y}, 0.7)) return Cobbles(x, y, {0.50f, 0.49f, 0.47f}, 0.12, 705);
  }
  // Beds of flowers in the lawns.
  const double bed = FractalNoise(0.2 * x, 0.2 * y, 2, 706);
  if (bed > 0.71) {
    const Cell plant = CellNoise(2.6 * x, 2.6 * y, 707);
    const Color petals = Mix({0.75f, 0.28f, 0.30f}, {0.92f, 0.80f, 0.34f}, 1.6 * plant.id - 0.3);
    return plant.edge_distance > 0.42 && plant.id > 0.25
               ? petals
               : RoughStone(2 * x, 2 * y, {0.30f, 0.30f, 0.17f}, 708);
  }
  return Grass(x, y, 709);
}

void PaintStreetMarks(const Town& town, Canvas& canvas, Rng& rng) {
  for (int street = 0; street < Town::kStreets; ++street) {
    const double length = Town::StreetLength(street);
    const auto mark = [&](double along, double aside, double half_along, double half_aside) {
      const Town::Place place = town.OnStreet(street, along);
      const Eigen::Vector2d right(place.along.y(), -place.along.x());
      const Eigen::Vector2d middle = place.at + aside * right;
      const double reach = half_along + half_aside;
      canvas.Paint({middle.x() - reach, middle.y() - reach, middle.x() + reach, middle.y() + reach},
                   [&](double x, double y, Color& texel) {
                     const Eigen::Vector2d offset = Eigen::Vector2d(x, y) - middle;
                     if (std::abs(offset.dot(place.along)) > half_along ||
                         std::abs(offset.dot(right)) > half_aside) {
                       return;
                     }
                     texel = Mix(texel, {0.93f, 0.92f, 0.88f},
                                 0.55 + 0.5 * FractalNoise(4 * x, 4 * y, 3, 711));
                   });
    };
    for (double along = 2; along < length; along += 6) mark(along, 0, 1.4, 0.07);
    for (double along = rng.Uniform(12, 25); along < length; along += rng.Uniform(28, 50)) {
      for (double aside = -2.7; aside < 2.8; aside += 0.9) mark(along, aside, 1.5, 0.24);
    }
    for (double along = rng.Uniform(3, 9); along < length; along += rng.Uniform(6, 15)) {
      const Town::Place place = town.OnStreet(street, along);
      const Eigen::Vector2d at =
          place.at + rng.Uniform(-2.4, 2.4) * Eigen::Vector2d(place.along.y(), -place.along.x());
      canvas.Disc(at.x(), at.y(), 0.4, {0.16f, 0.16f, 0.16f});
      canvas.Disc(at.x(), at.y(), 0.3, {0.42f, 0.41f, 0.40f});
    }
  }
}

}  // namespace

HouseStyle HouseStyle::Draw(Rng& rng) {
  HouseStyle style{};
  style.wall = std::array{Wall::kBrick, Wall::kPlaster, Wall::kPlaster, Wall::kTimber,
                          Wall::kPlanks}[rng.UniformIndex(5)];
  switch (style.wall) {
    case Wall::kBrick:
      style.base =
          DrawColor(rng, {{0.64f, 0.33f, 0.25f}, {0.50f, 0.30f, 0.26f}, {0.74f, 0.62f, 0.46f}});
      break;
    case Wall::kPlanks:
      style.base =
          DrawColor(rng, {{0.62f, 0.24f, 0.20f}, {0.44f, 0.56f, 0.62f}, {0.60f, 0.48f, 0.34f}});
      break;
    case Wall::kPlaster:
    case Wall::kTimber:
      style.base = DrawColor(rng, {{0.92f, 0.88f, 0.78f},
                                   {0.90f, 0.74f, 0.48f},
                                   {0.70f, 0.76f, 0.70f},
                                   {0.80f, 0.62f, 0.55f},
                                   {0.72f, 0.76f, 0.84f}});
  }
  style.trim =
      DrawColor(rng, {{0.40f, 0.27f, 0.19f}, {0.24f, 0.26f, 0.28f}, {0.30f, 0.38f, 0.30f}});
  style.roof = DrawColor(rng, {{1.0f, 1.0f, 1.0f}, {0.75f, 0.85f, 1.0f}, {0.55f, 0.85f, 1.25f}});
  style.plinth_m = rng.Uniform() < 0.6 ? rng.Uniform(0.4, 0.8) : 0;
  style.seed = static_cast<uint32_t>(rng.NextBits());
  return style;
}

Color HouseStyle::WallColor(double x, double y) const {
  if (y < plinth_m) return Ashlar(x, y, {0.64f, 0.62f, 0.58f}, 0.4, seed);
  switch (wall) {
    case Wall::kBrick: {
      const double lime = FractalNoise(0.6 * x, 0.6 * y, 5, seed + 2) - 0.56;
      return Mix(Brick(x, y, base, seed + 1), {0.80f, 0.74f, 0.66f}, 3.2 * lime);
    }
    case Wall::kPlanks:
      return Planks(x, y, base, 0.18, seed + 1);
    case Wall::kPlaster:
      return Plaster(x, y, base, seed + 1);
    case Wall::kTimber: {
      const double in_storey = std::fmod(y, 2.9);
      const double post = std::abs(std::fmod(x, 1.9) - 0.95);
      const double brace = std::abs(
          std::fmod(x + 0.3 * Hash(static_cast<int>(x / 1.9), 0, seed), 3.8) - 0.5 * in_storey);
      const bool is_beam = y > 2.9 && (post < 0.09 || in_storey < 0.2 || brace < 0.08);
      return is_beam ? Planks(y, x, trim, 0.4, seed + 3) : Plaster(x, y, base, seed + 1);
    }
  }
  return base;
}

Canvas PaintWall(const HouseStyle& style, double width_m, double height_m, double px_per_m) {
  Canvas canvas(width_m, height_m, px_per_m);
  canvas.Paint({0, 0, width_m, height_m},
               [&](double x, double y, Color& texel) { texel = style.WallColor(x, y); });
  Weather(canvas, style.seed + 5);
  return canvas;
}

Canvas PaintGable(const HouseStyle& style, double width_m, double rise_m, double wall_m,
                  double px_per_m, Rng& rng) {
  Canvas canvas(width_m, rise_m, px_per_m);
  canvas.Paint({0, 0, width_m, rise_m},
               [&](double x, double y, Color& texel) { texel = style.WallColor(x, y + wall_m); });
  const double side = std::min(1.1, 0.35 * rise_m);
  const Opening window{
      Opening::Kind::kWindow, 0.5 * (width_m - side), 0.25 * rise_m, side, side, 0};
  canvas.Fill(window.area().Inset(-0.1), style.trim);
  PaintOpening(canvas, window, rng);
  return canvas;
}

Canvas PaintRoof(const HouseStyle& style, House::Roof roof, double width_m, double height_m,
                 double px_per_m, Rng& rng) {
  Canvas canvas(width_m, height_m, px_per_m);
  const auto seed = static_cast<uint32_t>(rng.NextBits());
  const bool is_flat = roof == House::Roof::kFlat;
  canvas.Paint({0, 0, width_m, height_m}, [&](double x, double y, Color& texel) {
    if (is_flat) {
      const bool is_seam = std::fmod(x, 1.6) < 0.06;
      texel = RoughStone(x, y, {0.58f, 0.57f, 0.55f}, seed);
      const Cell puddle = CellNoise(0.3 * x, 0.3 * y, seed + 1);
      texel = Lit(texel, (is_seam ? 0.6 : 1) * (puddle.id > 0.6 ? 0.75 : 1));
      return;
    }
    texel = RoofTiles(x, y, seed).cwiseProduct(style.roof);
    // Tiles that were put in later, row by row.
    const Cell mended = CellNoise(0.35 * x, 0.5 * std::floor(y / 0.3) * 0.3, seed + 1);
    if (mended.id > 0.82) texel = Lit(texel, 1.35);
    if (mended.id < 0.12) texel = Lit(texel, 0.7);
  });
  const auto somewhere = [&](double w, double h) {
    const double x = rng.Uniform(0.2 * width_m, std::max(0.2 * width_m, 0.8 * width_m - w));
    const double y = rng.Uniform(0.15 * height_m, std::max(0.15 * height_m, 0.8 * height_m - h));
    return Rect{x, y, x + w, y + h};
  };
  if (rng.Uniform() < 0.4) PaintPanels(canvas, somewhere(0.4 * width_m, 0.45 * height_m));
  for (uint32_t i = rng.UniformIndex(3); i > 0; --i) {
    const Rect window = somewhere(0.8, 1.1);
    canvas.Fill(window.Inset(-0.08), {0.28f, 0.28f, 0.29f});
    canvas.Fill(window, {0.45f, 0.56f, 0.66f});
  }
  return canvas;
}

Canvas PaintTownGround(const Town& town, double px_per_m, Rng rng) {
  Canvas canvas(Town::kWidth, Town::kDepth, px_per_m);
  constexpr double kStrip = 5;
  ParallelFor(static_cast<size_t>(Town::kWidth / kStrip), 0, [&](size_t strip) {
    const double x0 = kStrip * static_cast<double>(strip);
    for (double y0 = 0; y0 < Town::kDepth; y0 += kStrip) {
      std::vector<const House*> near;
      for (const House& house : town.houses()) {
        constexpr double kReach = 32;  // of the farthest corner of a house and its path
        const Eigen::Vector2d offset = house.frame.origin.head<2>() - Eigen::Vector2d(x0, y0);
        if (offset.norm() < kReach) near.push_back(&house);
      }
      // Each texel's center lies in one square alone.
      constexpr double kShare = 1e-6;
      canvas.Paint(
          {x0, y0, x0 + kStrip - kShare, y0 + kStrip - kShare},
          [&](double x, double y, Color& texel) { texel = GroundColor(town, near, x, y); });
    }
  });
  PaintStreetMarks(town, canvas, rng);
  return canvas;
}

void PaintTraces(Canvas& canvas, double x0, double x1, Rng& rng) {
  constexpr std::array<const char*, 8> kTitles{"JAZZ",  "MARKET", "OPERA", "CHESS",
                                               "TANGO", "CIRCUS", "FAIR",  "CINEMA"};
  constexpr std::array<const char*, 6> kTags{"KLOX", "Nono", "ZEBRA", "MIRA", "ODO", "tik"};
  for (double x = x0 + rng.Uniform(0.1, 0.8); x + 0.8 < x1; x += rng.Uniform(0.9, 3.5)) {
    if (rng.Uniform() < 0.5) {
      PaintPoster(canvas, {x, 1.0, x + rng.Uniform(0.55, 0.75), rng.Uniform(1.7, 2.0)},
                  kTitles[rng.UniformIndex(8)], rng);
    } else if (x + 1.6 < x1) {
      PaintGraffiti(canvas, {x, 0.8, x + 1.5, 1.4}, kTags[rng.UniformIndex(6)],
                    {static_cast<float>(rng.Uniform()), static_cast<float>(rng.Uniform()),
                     static_cast<float>(rng.Uniform())},
                    rng);
    }
  }
}

}  // namespace raylift::demo
