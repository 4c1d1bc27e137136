#include "sheets.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "noise.h"
#include "surfaces.h"

namespace raylift::demo {

namespace {

constexpr double kWallPxPerM = 96;

Color RandomColor(Rng& rng, double low, double high) {
  return {static_cast<float>(rng.Uniform(low, high)), static_cast<float>(rng.Uniform(low, high)),
          static_cast<float>(rng.Uniform(low, high))};
}

// A spray can's bold bent line.
void PaintScrawl(Canvas& canvas, const Rect& area, const Color& color, Rng& rng) {
  double phase[4];
  for (double& value : phase) value = rng.Uniform(0, 2 * std::numbers::pi);
  for (int i = 0; i < 500; ++i) {
    const double t = i / 500.0;
    const double x = 0.5 + 0.48 * std::sin(5.1 * t + phase[0]) * std::cos(9.7 * t + phase[1]);
    const double y = 0.5 + 0.45 * std::sin(14.3 * t + phase[2]) * std::cos(4.4 * t + phase[3]);
    canvas.Disc(area.x0 + x * area.width(), area.y0 + y * area.height(), 0.035, color, 0.5);
  }
}

}  // namespace

void Weather(Canvas& canvas, uint32_t seed) {
  canvas.Paint({0, 0, canvas.width_m(), canvas.height_m()}, [&](double x, double y, Color& texel) {
    const double damp = 0.9 - y + 0.9 * (FractalNoise(1.5 * x, 1.5 * y, 4, seed) - 0.5);
    texel = Mix(texel, {0.30f, 0.30f, 0.25f}, 0.65 * damp);
    const double soot = y - canvas.height_m() + 1.0;
    texel =
        Mix(texel, {0.24f, 0.23f, 0.22f}, 0.7 * soot * FractalNoise(7 * x, 0.6 * y, 4, seed + 1));
  });
}

void PaintPoster(Canvas& canvas, const Rect& area, const std::string& title, Rng& rng) {
  const Color ground = RandomColor(rng, 0.3, 0.95), ink = RandomColor(rng, 0.02, 0.35);
  const auto seed = static_cast<uint32_t>(rng.NextBits());
  canvas.Paint(area, [&](double x, double y, Color& texel) {
    // Torn at the edges.
    const double edge = std::min({x - area.x0, area.x1 - x, y - area.y0, area.y1 - y});
    if (edge < 0.05 * FractalNoise(11 * x, 11 * y, 2, seed) - 0.01) return;
    texel = ground * static_cast<float>(0.85 + 0.25 * FractalNoise(6 * x, 6 * y, 3, seed + 1));
  });
  for (int i = 0; i < 6; ++i) {
    canvas.Disc(rng.Uniform(area.x0 + 0.15, area.x1 - 0.15),
                rng.Uniform(area.y0 + 0.22, area.y0 + 0.7 * area.height()), rng.Uniform(0.04, 0.16),
                RandomColor(rng, 0.05, 0.98), 0.85);
  }
  const double title_height = 0.15 * area.height();
  canvas.Text({area.x0 + 0.06, area.y1 - 0.05 - title_height, area.x1 - 0.06, area.y1 - 0.05},
              title, ink, 0.95);
  canvas.Text({area.x0 + 0.08, area.y0 + 0.05, area.x1 - 0.1, area.y0 + 0.05 + 0.5 * title_height},
              "SAT 14 JUNE", ink, 0.9);
}

void PaintGraffiti(Canvas& canvas, const Rect& area, const std::string& text, const Color& color,
                   Rng& rng) {
  PaintScrawl(canvas, area, RandomColor(rng, 0.2, 0.9), rng);
  const double shift = 0.025;
  canvas.Text({area.x0 + shift, area.y0 - shift, area.x1 + shift, area.y1 - shift}, text,
              {0.08f, 0.08f, 0.1f}, 0.85);
  canvas.Text(area, text, color, 0.92);
}

void PaintHouseNumber(Canvas& canvas, double x, double y, const std::string& number) {
  canvas.Fill({x, y, x + 0.26, y + 0.2}, {0.12f, 0.22f, 0.48f});
  canvas.Text({x + 0.05, y + 0.04, x + 0.21, y + 0.16}, number, {0.97f, 0.97f, 0.95f});
}

Canvas PaintNorthSheet(Rng rng) {
  Canvas canvas(16, 8.4, kWallPxPerM);
  canvas.Paint({0, 0, 16, 8.4}, [](double x, double y, Color& texel) {
    texel = Brick(x, y, {0.64f, 0.33f, 0.25f}, 201);
    const double lime = FractalNoise(0.6 * x, 0.6 * y, 5, 202) - 0.56;
    texel = Mix(texel, {0.80f, 0.74f, 0.66f}, 3.2 * lime);
    if (y < 0.75) texel = Ashlar(x, y, {0.62f, 0.60f, 0.56f}, 0.375, 203);
  });
  // A faded advertisement on the bricks.
  canvas.Fill({10.35, 2.55, 15.4, 3.25}, {0.90f, 0.86f, 0.74f}, 0.55);
  canvas.Text({10.6, 2.66, 15.2, 3.12}, "MOREL & FILS - VINS", {0.20f, 0.24f, 0.36f}, 0.72);
  Weather(canvas, 205);
  PaintPoster(canvas, {4.15, 0.95, 4.85, 1.95}, "JAZZ", rng);
  PaintPoster(canvas, {4.95, 1.05, 5.6, 1.9}, "CIRQUE", rng);
  PaintGraffiti(canvas, {13.9, 0.9, 15.6, 1.55}, "KLOX", {0.30f, 0.72f, 0.74f}, rng);
  PaintHouseNumber(canvas, 3.05, 2.0, "12");
  return canvas;
}

Canvas PaintEastSheet(Rng rng) {
  Canvas canvas(12, 6.2, kWallPxPerM);
  canvas.Paint({0, 0, 12, 6.2}, [](double x, double y, Color& texel) {
    texel = Plaster(x, y, {0.90f, 0.70f, 0.42f}, 301);
    if (y < 0.6) texel = Plaster(x, y, {0.60f, 0.42f, 0.30f}, 302);
    // A painted frieze.
    if (y > 3.12 && y < 3.42) {
      const double wave = 3.27 + 0.08 * std::sin(2 * std::numbers::pi * x / 0.5);
      if (std::abs(y - wave) < 0.03 || y < 3.15 || y > 3.39)
        texel = Mix(texel, {0.56f, 0.22f, 0.16f}, 0.8);
    }
  });
  Weather(canvas, 305);
  PaintPoster(canvas, {6.3, 1.0, 7.0, 2.0}, "MARKET", rng);
  PaintPoster(canvas, {7.05, 1.15, 7.6, 1.95}, "OPERA", rng);
  PaintPoster(canvas, {6.65, 2.05, 7.25, 2.8}, "CHESS", rng);
  PaintHouseNumber(canvas, 9.7, 2.3, "9");
  return canvas;
}

Canvas PaintSouthSheet(Rng rng) {
  Canvas canvas(16, 8.6, kWallPxPerM);
  canvas.Paint({0, 0, 16, 8.6}, [](double x, double y, Color& texel) {
    texel = y < 3.4 ? Ashlar(x, y, {0.82f, 0.77f, 0.67f}, 0.425, 401)
                    : Plaster(x, y, {0.94f, 0.89f, 0.78f}, 402);
    // Timber framing in the top floor.
    if (y > 6.1) {
      const double post = std::abs(std::fmod(x, 2.0) - 1.0);
      const double brace = std::abs(std::fmod(x, 2.0) - 0.45 * (y - 6.1));
      const double rail = std::min(std::abs(y - 6.2), std::abs(y - 8.3));
      if (post < 0.09 || rail < 0.1 || brace < 0.08) {
        texel = Planks(y, x, {0.40f, 0.27f, 0.19f}, 0.4, 403);
      }
    }
  });
  Weather(canvas, 405);
  PaintGraffiti(canvas, {9.4, 0.85, 10.75, 1.5}, "Nono", {0.92f, 0.46f, 0.62f}, rng);
  PaintPoster(canvas, {15.1, 1.0, 15.75, 1.95}, "LOST CAT", rng);
  // A sundial.
  canvas.Disc(8.0, 5.75, 0.62, {0.95f, 0.91f, 0.80f});
  canvas.Disc(8.0, 5.75, 0.06, {0.25f, 0.2f, 0.15f});
  for (int hour = 0; hour < 12; ++hour) {
    const double a = 2 * std::numbers::pi * hour / 12;
    canvas.Text({8.0 + 0.48 * std::cos(a) - 0.07, 5.75 + 0.48 * std::sin(a) - 0.06,
                 8.0 + 0.48 * std::cos(a) + 0.07, 5.75 + 0.48 * std::sin(a) + 0.06},
                std::to_string(hour + 1), {0.25f, 0.16f, 0.30f});
  }
  return canvas;
}

Canvas PaintWestSheet(Rng rng) {
  Canvas canvas(12, 7, kWallPxPerM);
  canvas.Paint({0, 0, 12, 7}, [](double x, double y, Color& texel) {
    texel = Plaster(x, y, {0.66f, 0.73f, 0.66f}, 501);
    // Ivy that is too flat to model, under the leaves that are.
    const double reach = 5.4 - 0.55 * std::abs(x - 9.0) * std::abs(x - 9.0);
    if (y < reach + 3 * (FractalNoise(1.8 * x, 1.8 * y, 4, 502) - 0.5)) {
      texel = Foliage(x, y, {0.27f, 0.38f, 0.15f}, 503);
    }
  });
  Weather(canvas, 505);
  PaintGraffiti(canvas, {4.1, 1.0, 5.9, 1.7}, "ZEBRA", {0.97f, 0.85f, 0.25f}, rng);
  PaintPoster(canvas, {0.15, 1.1, 0.75, 1.95}, "YOGA", rng);
  PaintHouseNumber(canvas, 6.12, 2.15, "3");
  return canvas;
}

Canvas PaintGround(Rng rng) {
  Canvas canvas(16, 12, 88);
  canvas.Paint({0, 0, 16, 12}, [](double x, double y, Color& texel) {
    const double radius = std::hypot(x - 8, y - 6), angle = std::atan2(y - 6, x - 8);
    texel = Cobbles(x, y, {0.56f, 0.53f, 0.49f}, 0.17, 601);
    if (radius < 3.3) {
      // Rings around the fountain.
      const double ring = std::round(radius / 0.3) * 0.3;
      texel = Brick(ring * angle, radius * 0.28, {0.60f, 0.42f, 0.34f}, 602);
      if (radius > 3.0)
        texel = Flagstones(4 * angle, radius - 3.0, {0.72f, 0.69f, 0.63f}, 0.3, 603);
    } else if (std::abs(y - 6 - 0.5 * std::sin(0.6 * x)) < 0.62) {
      texel = Flagstones(x, y - 0.5 * std::sin(0.6 * x), {0.72f, 0.68f, 0.61f}, 0.41, 604);
    } else if (std::min({x, y, 16 - x, 12 - y}) < 0.95) {
      texel = Flagstones(x, y, {0.64f, 0.62f, 0.58f}, 0.475, 605);
    }
    texel *= static_cast<float>(0.80 + 0.35 * FractalNoise(0.8 * x, 0.8 * y, 5, 606));
    texel = Mix(texel, {0.34f, 0.38f, 0.20f}, 3 * (FractalNoise(0.9 * x, 0.9 * y, 5, 607) - 0.62));
  });
  // Hopscotch in chalk, manholes, oil, fallen leaves.
  for (int i = 0; i < 7; ++i) {
    const double y = 2.2 + 0.45 * i, x = 12.6;
    for (double line : {0.0, 0.43})
      canvas.Fill({x, y + line, x + 0.5, y + line + 0.03}, {0.93f, 0.92f, 0.86f}, 0.7);
    for (double line : {0.0, 0.47})
      canvas.Fill({x + line, y, x + line + 0.03, y + 0.45}, {0.93f, 0.92f, 0.86f}, 0.7);
    canvas.Text({x + 0.15, y + 0.1, x + 0.36, y + 0.36}, std::to_string(i + 1),
                {0.93f, 0.80f, 0.86f}, 0.8);
  }
  for (const auto& [x, y] : {std::pair{4.3, 9.1}, std::pair{12.1, 8.6}, std::pair{5.0, 2.4}}) {
    canvas.Disc(x, y, 0.36, {0.20f, 0.19f, 0.18f});
    canvas.Disc(x, y, 0.31, {0.36f, 0.34f, 0.32f});
    for (int k = -3; k <= 3; ++k)
      canvas.Fill({x - 0.2, y + 0.07 * k - 0.012, x + 0.2, y + 0.07 * k + 0.012},
                  {0.14f, 0.13f, 0.13f});
  }
  for (int i = 0; i < 26; ++i) {
    canvas.Disc(rng.Uniform(1, 15), rng.Uniform(1, 11), rng.Uniform(0.08, 0.3),
                {0.18f, 0.16f, 0.14f}, 0.25);
  }
  for (int i = 0; i < 900; ++i) {
    const bool is_west = rng.Uniform() < 0.5;
    canvas.Disc((is_west ? 2.2 : 13.9) + 1.3 * rng.Normal(),
                (is_west ? 9.9 : 2.1) + 1.3 * rng.Normal(), rng.Uniform(0.012, 0.035),
                {static_cast<float>(rng.Uniform(0.4, 0.75)),
                 static_cast<float>(rng.Uniform(0.35, 0.55)), 0.15f});
  }
  return canvas;
}

}  // namespace raylift::demo
