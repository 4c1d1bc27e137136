#include "materials.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "noise.h"
#include "surfaces.h"

namespace raylift::demo {

namespace {

Material AddLouvers(Atlas& atlas, const Color& base, uint32_t seed) {
  return atlas.Add(0.5, 1.5, [&](double x, double y) {
    const bool is_border =
        x < 0.06 || x > 0.44 || y < 0.07 || y > 1.43 || std::abs(y - 0.75) < 0.04;
    const double slat = is_border ? 0.9 : 0.55 + 0.5 * std::fmod(y, 0.06) / 0.06;
    const double worn = FractalNoise(7 * x, 3 * y, 4, seed);
    return Mix(base * static_cast<float>(slat), {0.62f, 0.56f, 0.47f}, 4 * (worn - 0.6));
  });
}

Material AddCrate(Atlas& atlas, const std::string& stencil, const Color& ink, uint32_t seed) {
  Material crate = atlas.Add(0.8, 0.8, [&](double x, double y) {
    const bool is_rim = std::min({x, y, 0.8 - x, 0.8 - y}) < 0.09;
    const bool is_brace = std::abs(x - y) < 0.06;
    Color color = is_rim && (y < 0.09 || y > 0.71)
                      ? Planks(y, x, {0.62f, 0.47f, 0.30f}, 0.09, seed)
                      : Planks(x, y, {0.70f, 0.55f, 0.37f}, is_rim || is_brace ? 0.10 : 0.13, seed);
    if (!is_rim && !is_brace) color *= 0.8f;
    const double nail =
        std::hypot(std::fmod(x + 0.045, 0.71) - 0.09, std::fmod(y + 0.045, 0.71) - 0.09);
    return nail < 0.012 ? Color(0.15f, 0.14f, 0.14f) : color;
  });
  atlas.Decorate(crate, [&](Canvas& canvas, const Rect& area) {
    canvas.Text({area.x0 + 0.12, area.y0 + 0.28, area.x1 - 0.12, area.y0 + 0.50}, stencil, ink,
                0.85);
  });
  return crate;
}

Material AddSign(Atlas& atlas, const std::string& text, const Color& ground, const Color& ink,
                 uint32_t seed) {
  Material sign = atlas.Add(2.2, 0.5, [&](double x, double y) {
    const bool is_border = std::min({x, y, 2.2 - x, 0.5 - y}) < 0.03;
    return Metal(x, y, is_border ? ink : ground, seed);
  });
  atlas.Decorate(sign, [&](Canvas& canvas, const Rect& area) {
    canvas.Text({area.x0 + 0.15, area.y0 + 0.09, area.x1 - 0.15, area.y1 - 0.09}, text, ink, 0.95);
  });
  return sign;
}

Material AddCloth(Atlas& atlas, const Color& base, const Color& second, int pattern,
                  uint32_t seed) {
  return atlas.Add(0.9, 0.9, [&](double x, double y) {
    bool is_second = false;
    if (pattern == 0) is_second = std::fmod(x, 0.18) < 0.07;
    if (pattern == 1) is_second = (std::fmod(x, 0.2) < 0.1) != (std::fmod(y, 0.2) < 0.1);
    if (pattern == 2)
      is_second = std::hypot(std::fmod(x, 0.15) - 0.07, std::fmod(y, 0.15) - 0.07) < 0.035;
    if (pattern == 3) is_second = y < 0.12 || y > 0.78 || std::abs(y - 0.45) < 0.03;
    return Cloth(x, y, is_second ? second : base, seed);
  });
}

Material AddMenuBoard(Atlas& atlas) {
  Material board = atlas.Add(0.6, 1.0, [&](double x, double y) {
    const bool is_frame = std::min({x, y, 0.6 - x, 1.0 - y}) < 0.05;
    const double smear = 0.10 * FractalNoise(5 * x, 9 * y, 3, 71);
    return is_frame ? Planks(x, y, {0.52f, 0.34f, 0.2f}, 0.3, 72)
                    : Color::Constant(static_cast<float>(0.11 + smear));
  });
  atlas.Decorate(board, [](Canvas& canvas, const Rect& area) {
    const std::vector<std::string> lines{"MENU", "soup of the day", "quiche  7.50", "tarte",
                                         "cafe 2.-"};
    for (size_t i = 0; i < lines.size(); ++i) {
      const double top = area.y1 - 0.10 - 0.17 * static_cast<double>(i);
      canvas.Text({area.x0 + 0.09, top - 0.11, area.x1 - 0.09 - (i > 2 ? 0.12 : 0.0), top},
                  lines[i], i == 0 ? Color(0.98f, 0.85f, 0.45f) : Color(0.92f, 0.92f, 0.88f), 0.9);
    }
  });
  return board;
}

void AddPaintsAndStones(Atlas& atlas, Materials& m) {
  const auto paint = [&](const Color& base, uint32_t seed) {
    return atlas.Add(1.0, 0.8, [=](double x, double y) {
      const double worn = FractalNoise(6 * x, 6 * y, 4, seed);
      return Mix(Planks(x, y, base, 0.25, seed), {0.55f, 0.47f, 0.38f}, 6 * (worn - 0.63));
    });
  };
  m.white_paint = paint({0.98f, 0.96f, 0.90f}, 1);
  m.green_paint = paint({0.22f, 0.42f, 0.30f}, 2);
  m.blue_paint = paint({0.28f, 0.45f, 0.66f}, 3);
  m.red_paint = paint({0.66f, 0.20f, 0.16f}, 4);
  m.stone = atlas.Add(1.5, 1.5, [](double x, double y) {
    return RoughStone(x, y, {0.74f, 0.71f, 0.65f}, 11);
  });
  m.pale_stone = atlas.Add(1.5, 1.0, [](double x, double y) {
    return RoughStone(x, y, {0.90f, 0.86f, 0.77f}, 12);
  });
  m.wood = atlas.Add(1.2, 1.0, [](double x, double y) {
    return Planks(x, y, {0.72f, 0.54f, 0.36f}, 0.12, 13);
  });
  m.dark_wood = atlas.Add(1.2, 1.0, [](double x, double y) {
    return Planks(x, y, {0.46f, 0.31f, 0.20f}, 0.15, 14);
  });
  m.iron = atlas.Add(0.5, 0.5, [](double x, double y) {
    return Metal(x, y, {0.17f, 0.18f, 0.19f}, 15);
  });
  m.copper = atlas.Add(0.5, 0.8, [](double x, double y) {
    return Metal(x, y, {0.40f, 0.56f, 0.50f}, 16);
  });
  m.terracotta = atlas.Add(1.0, 0.6, [](double x, double y) {
    return RoughStone(
        x, y, std::fmod(y, 0.2) < 0.03 ? Color(0.52f, 0.28f, 0.19f) : Color(0.80f, 0.46f, 0.31f),
        17);
  });
  m.roof = atlas.Add(4.0, 2.4, [](double x, double y) { return RoofTiles(x, y, 18); });
  m.bark = atlas.Add(0.8, 1.6, [](double x, double y) { return Bark(x, y, 19); });
  m.soil = atlas.Add(0.6, 0.6, [](double x, double y) {
    return RoughStone(2 * x, 2 * y, {0.32f, 0.23f, 0.16f}, 20);
  });
  m.water = atlas.Add(1.5, 1.5, [](double x, double y) { return Water(x, y, 21); });
}

void AddPlants(Atlas& atlas, Materials& m) {
  const std::vector<Color> greens{{0.30f, 0.46f, 0.16f}, {0.22f, 0.38f, 0.15f},
                                  {0.42f, 0.54f, 0.20f}, {0.36f, 0.44f, 0.14f},
                                  {0.50f, 0.52f, 0.18f}, {0.26f, 0.42f, 0.22f}};
  for (size_t i = 0; i < greens.size(); ++i) {
    m.leaves.push_back(atlas.Add(0.2, 0.2, [&](double x, double y) {
      const double vein = std::abs(x - y) < 0.008 ? 1.25 : 1;
      const double shade =
          0.7 + 0.5 * FractalNoise(20 * x, 20 * y, 2, 30 + static_cast<uint32_t>(i));
      return Color(greens[i] * static_cast<float>(vein * shade));
    }));
  }
  for (const Color& petal : {Color(0.85f, 0.20f, 0.26f), Color(0.95f, 0.72f, 0.22f),
                             Color(0.80f, 0.42f, 0.74f), Color(0.96f, 0.92f, 0.88f)}) {
    m.flowers.push_back(atlas.Add(0.2, 0.2, [&](double x, double y) {
      const double r = std::hypot(x - 0.1, y - 0.1);
      return r < 0.03 ? Color(0.95f, 0.8f, 0.2f) : Color(petal * static_cast<float>(1 - 2.5 * r));
    }));
  }
}

}  // namespace

Materials PaintMaterials(Atlas& atlas) {
  Materials m;
  AddPaintsAndStones(atlas, m);
  m.louvers_blue = AddLouvers(atlas, {0.33f, 0.50f, 0.70f}, 40);
  m.louvers_green = AddLouvers(atlas, {0.24f, 0.44f, 0.33f}, 41);
  m.louvers_brown = AddLouvers(atlas, {0.50f, 0.32f, 0.22f}, 42);
  m.awning = atlas.Add(3.2, 1.2, [](double x, double y) {
    return Cloth(x, y,
                 std::fmod(x, 0.4) < 0.2 ? Color(0.78f, 0.20f, 0.17f) : Color(0.95f, 0.92f, 0.84f),
                 50);
  });
  m.parasol = atlas.Add(1.6, 0.8, [](double x, double y) {
    return Cloth(x, y,
                 std::fmod(x, 0.4) < 0.2 ? Color(0.95f, 0.74f, 0.25f) : Color(0.94f, 0.92f, 0.86f),
                 51);
  });
  m.menu_board = AddMenuBoard(atlas);
  m.lamp_glass = atlas.Add(0.3, 0.3, [](double x, double) {
    return Mix({0.98f, 0.93f, 0.72f}, {0.75f, 0.70f, 0.55f}, 12 * std::abs(x - 0.15) - 0.8);
  });
  m.barrel = atlas.Add(1.6, 0.9, [](double x, double y) {
    const bool is_hoop = std::abs(y - 0.14) < 0.03 || std::abs(y - 0.76) < 0.03 ||
                         std::abs(y - 0.33) < 0.02 || std::abs(y - 0.57) < 0.02;
    return is_hoop ? Metal(x, y, {0.28f, 0.27f, 0.27f}, 60)
                   : Planks(x, y, {0.60f, 0.40f, 0.24f}, 0.08, 61);
  });
  AddPlants(atlas, m);
  m.crates = {AddCrate(atlas, "FRAGILE", {0.65f, 0.15f, 0.1f}, 80),
              AddCrate(atlas, "No. 47", {0.1f, 0.1f, 0.12f}, 81),
              AddCrate(atlas, "LEMONS", {0.15f, 0.3f, 0.2f}, 82),
              AddCrate(atlas, "A. MOREL", {0.12f, 0.15f, 0.4f}, 83)};
  m.cloths = {AddCloth(atlas, {0.92f, 0.90f, 0.86f}, {0.30f, 0.45f, 0.70f}, 0, 90),
              AddCloth(atlas, {0.86f, 0.45f, 0.35f}, {0.96f, 0.90f, 0.82f}, 1, 91),
              AddCloth(atlas, {0.36f, 0.56f, 0.52f}, {0.94f, 0.88f, 0.60f}, 2, 92),
              AddCloth(atlas, {0.94f, 0.92f, 0.90f}, {0.72f, 0.20f, 0.24f}, 3, 93),
              AddCloth(atlas, {0.55f, 0.50f, 0.70f}, {0.95f, 0.93f, 0.96f}, 2, 94),
              AddCloth(atlas, {0.92f, 0.78f, 0.36f}, {0.45f, 0.30f, 0.18f}, 0, 95)};
  m.signs = {AddSign(atlas, "CAFE ORIEL", {0.16f, 0.26f, 0.22f}, {0.93f, 0.82f, 0.52f}, 100),
             AddSign(atlas, "BOOKS & MAPS", {0.52f, 0.12f, 0.12f}, {0.95f, 0.90f, 0.80f}, 101),
             AddSign(atlas, "ATELIER 7", {0.88f, 0.85f, 0.76f}, {0.16f, 0.22f, 0.42f}, 102),
             AddSign(atlas, "COOPERAGE", {0.30f, 0.22f, 0.15f}, {0.90f, 0.78f, 0.48f}, 103)};
  return m;
}

}  // namespace raylift::demo
