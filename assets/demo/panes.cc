#include "panes.h"

#include <algorithm>
#include <cmath>

#include "noise.h"
#include "surfaces.h"

namespace raylift::demo {

namespace {

void PaintGlass(Canvas& canvas, const Rect& area, uint32_t seed) {
  canvas.Paint(area, [&](double x, double y, Color& texel) {
    const double up = (y - area.y0) / area.height();
    const double reflection = FractalNoise(1.6 * x + 0.5 * y, 1.6 * y, 4, seed);
    texel = Mix({0.09f, 0.11f, 0.13f}, {0.48f, 0.57f, 0.66f}, 1.1 * up * reflection);
    if (FractalNoise(0.9 * (x + y), 0.9 * (y - x), 2, seed + 3) > 0.62)
      texel += Color::Constant(0.07f);
  });
}

void PaintCurtains(Canvas& canvas, const Rect& area, Rng& rng) {
  static const Color kCloths[]{{0.90f, 0.88f, 0.82f},
                               {0.70f, 0.30f, 0.26f},
                               {0.85f, 0.72f, 0.44f},
                               {0.42f, 0.52f, 0.64f},
                               {0.55f, 0.62f, 0.46f}};
  const Color cloth = kCloths[rng.UniformIndex(5)];
  const double left = rng.Uniform(0.10, 0.45), right = rng.Uniform(0.10, 0.45);
  const double folds = rng.Uniform(35, 60), tie = rng.Uniform(0.3, 0.6);
  canvas.Paint(area, [&](double x, double y, Color& texel) {
    const double s = (x - area.x0) / area.width(), up = (y - area.y0) / area.height();
    const double gather = 0.55 + 0.45 * std::min(1.0, 2.2 * std::abs(up - tie));
    if (s > left * gather && 1 - s > right * gather) return;
    const double fold = 0.72 + 0.22 * std::sin(folds * x / gather);
    texel = Mix(texel, cloth * static_cast<float>(fold), 0.92);
  });
}

void PaintBlind(Canvas& canvas, const Rect& area, Rng& rng) {
  const double bottom = area.y0 + area.height() * rng.Uniform(0.05, 0.75);
  const double pitch = rng.Uniform(0.045, 0.07);
  canvas.Paint({area.x0, bottom, area.x1, area.y1}, [&](double, double y, Color& texel) {
    texel =
        Color(0.84f, 0.80f, 0.70f) * static_cast<float>(0.62 + 0.38 * std::fmod(y, pitch) / pitch);
  });
}

// Pots on the inner sill, a lamp or a picture in the room.
void PaintRoom(Canvas& canvas, const Rect& area, Rng& rng) {
  if (rng.Uniform() < 0.4) {
    const double x = rng.Uniform(area.x0 + 0.25, area.x1 - 0.25);
    const double y = area.y0 + area.height() * rng.Uniform(0.55, 0.8);
    for (int ring = 10; ring > 0; --ring)
      canvas.Disc(x, y, 0.035 * ring, {1.0f, 0.80f, 0.45f}, 0.09);
  }
  const uint32_t pots = rng.UniformIndex(4);
  for (uint32_t i = 0; i < pots; ++i) {
    const double x = rng.Uniform(area.x0 + 0.1, area.x1 - 0.1), size = rng.Uniform(0.05, 0.11);
    canvas.Fill({x - size, area.y0, x + size, area.y0 + 1.6 * size}, {0.66f, 0.38f, 0.26f});
    for (int leaf = 0; leaf < 14; ++leaf) {
      canvas.Disc(x + rng.Uniform(-1.5, 1.5) * size, area.y0 + rng.Uniform(1.7, 4.5) * size,
                  rng.Uniform(0.2, 0.5) * size,
                  {0.22f, static_cast<float>(rng.Uniform(0.3, 0.6)), 0.16f});
    }
  }
}

void PaintShopShelves(Canvas& canvas, const Rect& area, Rng& rng) {
  for (double y = area.y0 + 0.1; y < area.y1 - 0.3; y += 0.42) {
    canvas.Fill({area.x0, y - 0.03, area.x1, y}, {0.45f, 0.33f, 0.22f});
    for (double x = area.x0 + 0.05; x < area.x1 - 0.1;) {
      const double width = rng.Uniform(0.04, 0.14), height = rng.Uniform(0.16, 0.34);
      const Color color(static_cast<float>(rng.Uniform(0.15, 0.85)),
                        static_cast<float>(rng.Uniform(0.15, 0.7)),
                        static_cast<float>(rng.Uniform(0.12, 0.6)));
      canvas.Fill({x, y, x + width, y + height}, color);
      canvas.Fill({x, y + 0.6 * height, x + width, y + 0.75 * height},
                  Mix(color, {1, 1, 0.9f}, 0.6));
      x += width + (rng.Uniform() < 0.2 ? 0.12 : 0.012);
    }
  }
}

void PaintDoor(Canvas& canvas, const Opening& door, Rng& rng) {
  const Rect area = door.area();
  const auto seed = static_cast<uint32_t>(rng.NextBits());
  canvas.Paint(area, [&](double x, double y, Color& texel) {
    texel = Planks(x - area.x0, y, door.paint, 0.16, seed);
    const double dirt = (0.5 - (y - area.y0)) * FractalNoise(5 * x, 5 * y, 3, seed + 1);
    texel = Mix(texel, {0.28f, 0.25f, 0.21f}, 1.6 * dirt);
  });
  const int leaves = area.width() > 1.6 ? 2 : 1;
  const double leaf_width = area.width() / leaves;
  for (int leaf = 0; leaf < leaves; ++leaf) {
    for (const auto& [low, high] : {std::pair{0.15, 0.42}, std::pair{0.50, 0.82}}) {
      const Rect panel{area.x0 + (leaf + 0.17) * leaf_width, area.y0 + low * area.height(),
                       area.x0 + (leaf + 0.83) * leaf_width, area.y0 + high * area.height()};
      canvas.Fill(panel, {0.05f, 0.04f, 0.04f}, 0.55);
      canvas.Paint(panel.Inset(0.035), [&](double x, double y, Color& texel) {
        texel = Planks(y, x, Mix(door.paint, {1, 1, 1}, 0.08), 0.5, seed + 2);
      });
    }
    const double knob_x = leaf == 0 ? area.x0 + leaf_width - 0.09 : area.x0 + leaf_width + 0.09;
    canvas.Disc(knob_x, area.y0 + 1.02, 0.04, {0.80f, 0.66f, 0.30f});
  }
  canvas.Fill({area.x0 + 0.5 * area.width() - 0.14, area.y0 + 1.12,
               area.x0 + 0.5 * area.width() + 0.14, area.y0 + 1.19},
              {0.78f, 0.64f, 0.30f}, leaves == 1 ? 1 : 0);
}

void PaintGate(Canvas& canvas, const Opening& gate, Rng& rng) {
  const Rect area = gate.area();
  const auto seed = static_cast<uint32_t>(rng.NextBits());
  canvas.Paint(area, [&](double x, double y, Color& texel) {
    texel = Planks(x, y, gate.paint, 0.2, seed);
    if (std::abs(x - 0.5 * (area.x0 + area.x1)) < 0.02) texel *= 0.2f;
    for (double bar : {0.35, 1.35, 2.35}) {
      if (std::abs(y - area.y0 - bar) < 0.05) texel = Metal(x, y, {0.20f, 0.20f, 0.21f}, seed + 1);
    }
  });
  for (double y : {0.35, 1.35, 2.35}) {
    for (double x = area.x0 + 0.12; x < area.x1; x += 0.22) {
      canvas.Disc(x, area.y0 + y, 0.022, {0.52f, 0.50f, 0.47f});
    }
  }
}

}  // namespace

void PaintOpening(Canvas& canvas, const Opening& opening, Rng& rng) {
  const Rect area = opening.area();
  const auto seed = static_cast<uint32_t>(rng.NextBits());
  switch (opening.kind) {
    case Opening::Kind::kWindow: {
      PaintGlass(canvas, area, seed);
      PaintRoom(canvas, area, rng);
      const double furnishing = rng.Uniform();
      if (furnishing < 0.6) PaintCurtains(canvas, area, rng);
      if (furnishing > 0.5 && furnishing < 0.85) PaintBlind(canvas, area, rng);
      break;
    }
    case Opening::Kind::kShopWindow:
      PaintGlass(canvas, area, seed);
      PaintShopShelves(canvas, area, rng);
      break;
    case Opening::Kind::kDoor:
      PaintDoor(canvas, opening, rng);
      break;
    case Opening::Kind::kGate:
      PaintGate(canvas, opening, rng);
      break;
    case Opening::Kind::kNiche:
      canvas.Paint(area, [&](double x, double y, Color& texel) {
        texel = RoughStone(x, y, {0.62f, 0.58f, 0.52f}, seed);
      });
      break;
  }
}

}  // namespace raylift::demo
