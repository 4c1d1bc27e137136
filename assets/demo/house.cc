#include "house.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "facade.h"
#include "panes.h"
#include "sheets.h"
#include "town_sheets.h"

namespace raylift::demo {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Kind = Opening::Kind;
using Roof = House::Roof;

constexpr double kWallPxPerM = 40, kRoofPxPerM = 24;
constexpr double kEaves = 0.5, kVerge = 0.35, kSlab = 0.16;  // how far roofs reach, and are thick
constexpr double kStorey = 2.9;

// Canvases one below the other, as one picture.
class Sheet {
 public:
  explicit Sheet(int texture) : texture_(texture) {}

  size_t Add(Canvas canvas) {
    canvases_.push_back(std::move(canvas));
    return canvases_.size() - 1;
  }
  Canvas& canvas(size_t i) { return canvases_[i]; }

  // When all are added.
  Material MaterialOf(size_t i) const {
    const Vector2d size = Vector2d(Extent().first, Extent().second);
    int below = Extent().second;
    for (size_t k = 0; k <= i; ++k) below -= Rows(canvases_[k]);
    const Vector2d low(0.5, below + 0.5);
    const Vector2d high(Columns(canvases_[i]) - 0.5, below + Rows(canvases_[i]) - 0.5);
    return {texture_,
            low.cwiseQuotient(size),
            high.cwiseQuotient(size),
            {canvases_[i].width_m(), canvases_[i].height_m()}};
  }

  Image ToImage() const {
    const auto [width, height] = Extent();
    Image image{width, height, 3, std::vector<uint8_t>(static_cast<size_t>(width) * height * 3)};
    int top = 0;
    for (const Canvas& canvas : canvases_) {
      const Image part = canvas.ToImage();
      for (int row = 0; row < part.height_px; ++row) {
        std::copy_n(part.Pixel(0, row), 3 * part.width_px, image.Pixel(0, top + row));
      }
      top += part.height_px;
    }
    return image;
  }

 private:
  static int Columns(const Canvas& c) {
    return static_cast<int>(std::lround(c.width_m() * c.px_per_m()));
  }
  static int Rows(const Canvas& c) {
    return static_cast<int>(std::lround(c.height_m() * c.px_per_m()));
  }
  std::pair<int, int> Extent() const {
    std::pair<int, int> extent{0, 0};
    for (const Canvas& canvas : canvases_) {
      extent.first = std::max(extent.first, Columns(canvas));
      extent.second += Rows(canvas);
    }
    return extent;
  }

  int texture_;
  std::vector<Canvas> canvases_;
};

// How a house's windows look, the same on all its sides.
struct WindowStyle {
  double width, height, spacing;
  Opening::Top top;
  bool has_surrounds;
  const Material* joinery;
  const Material* stone;
  const Material* louvers;  // may be null
};

WindowStyle DrawWindows(const Materials& m, Rng& rng) {
  const std::array joinery{&m.white_paint, &m.white_paint, &m.dark_wood, &m.green_paint,
                           &m.blue_paint};
  const std::array<const Material*, 6> louvers{nullptr,         nullptr,          nullptr,
                                               &m.louvers_blue, &m.louvers_green, &m.louvers_brown};
  WindowStyle style{};
  style.width = rng.Uniform(0.85, 1.25);
  style.height = rng.Uniform(1.2, 1.6);
  style.spacing = style.width + rng.Uniform(0.9, 1.5);
  style.top = rng.Uniform() < 0.2 ? Opening::Top::kArched : Opening::Top::kFlat;
  style.joinery = joinery[rng.UniformIndex(5)];
  style.stone = rng.Uniform() < 0.5 ? &m.stone : &m.pale_stone;
  style.louvers = louvers[rng.UniformIndex(6)];
  if (style.louvers != nullptr) style.spacing = std::max(style.spacing, 2.1 * style.width);
  style.has_surrounds = style.louvers == nullptr && rng.Uniform() < 0.7;
  return style;
}

// The openings of a side: rows of windows; a door, and sometimes a shop, where the street is.
std::vector<Opening> PlanOpenings(const House& house, int side, const WindowStyle& style,
                                  Rng& rng) {
  const double width = house.SideLength(side);
  const bool is_front = side == house.front;
  std::vector<Opening> openings;
  if (is_front) {
    const Color paint(static_cast<float>(rng.Uniform(0.15, 0.6)),
                      static_cast<float>(rng.Uniform(0.15, 0.45)),
                      static_cast<float>(rng.Uniform(0.1, 0.5)));
    openings.push_back({Kind::kDoor, 0.5 * width - 0.55, 0, 1.1, 2.3, 0.22, style.top, paint});
    if (rng.Uniform() < 0.3) {
      openings.push_back({Kind::kShopWindow, 0.5 * width + 1.1, 0.6, 2.3, 1.8, 0.12});
    }
  }
  const int columns = std::max(1, static_cast<int>((width - 1.2) / style.spacing));
  const double first = 0.5 * (width - (columns - 1) * style.spacing - style.width);
  for (int storey = 0; kStorey * (storey + 1) < house.wall_m; ++storey) {
    for (int column = 0; column < columns; ++column) {
      const double x = first + column * style.spacing;
      const Opening window{
          Kind::kWindow, x, kStorey * storey + 0.95, style.width, style.height, 0.14, style.top};
      const bool is_taken = std::any_of(openings.begin(), openings.end(), [&](const Opening& o) {
        return o.x < x + style.width + 0.5 && x - 0.5 < o.x + o.width &&
               o.y < window.y + window.height + 0.2 && window.y < o.y + o.height + 0.3;
      });
      if (is_taken || (!is_front && rng.Uniform() < 0.35)) continue;
      openings.push_back(window);
    }
  }
  return openings;
}

// From the ground floor down into the ground.
void AddFoot(const Frame& wall, double width, double foot_m, const Material& stone,
             MeshBuilder& mesh, Rng& rng) {
  const int pieces = static_cast<int>(std::ceil(width / 1.5));
  for (int i = 0; i < pieces; ++i) {
    const double x0 = width * i / pieces, x1 = width * (i + 1) / pieces;
    mesh.Quad(wall.At(x0, -foot_m, 0), wall.At(x1, -foot_m, 0), wall.At(x1, 0, 0),
              wall.At(x0, 0, 0), stone.Piece(x1 - x0, foot_m, rng));
  }
}

void AddParapet(const Frame& wall, double width, double top, const Material& stone,
                MeshBuilder& mesh, Rng& rng) {
  const int pieces = static_cast<int>(width / 1.3);
  for (int i = 0; i < pieces; ++i) {
    const double step = width / pieces;
    mesh.Box(wall, {i * step, top - 0.15, -0.25}, {(i + 1) * step, top + 0.3, 0.08}, stone, rng);
  }
}

class HouseBuilder {
 public:
  HouseBuilder(const House& house, const Materials& materials, int number, int texture, Rng& rng)
      : house_(house), m_(materials), number_(number), sheet_(texture), rng_(rng) {}

  BuiltHouse Build() {
    const HouseStyle style = HouseStyle::Draw(rng_);
    const WindowStyle windows = DrawWindows(m_, rng_);
    for (int side = 0; side < 4; ++side) {
      sheet_.Add(PaintWall(style, house_.SideLength(side), house_.wall_m, kWallPxPerM));
    }
    // A roof's panel is as high as its rafters are long, with the eaves.
    const double run = 0.5 * house_.width_m + kEaves;
    const double rafter = is_flat() ? house_.width_m : std::hypot(run, run * house_.slope());
    for (int panel = 0; panel < (is_flat() ? 1 : 2); ++panel) {
      sheet_.Add(
          PaintRoof(style, house_.roof, house_.length_m + 2 * kEaves, rafter, kRoofPxPerM, rng_));
    }
    const bool has_gables = house_.roof == Roof::kGabled;
    for (int gable = 0; gable < (has_gables ? 2 : 0); ++gable) {
      sheet_.Add(
          PaintGable(style, house_.width_m, house_.rise_m, house_.wall_m, kWallPxPerM, rng_));
    }
    for (int side = 0; side < 4; ++side) BuildSide(side, windows);
    if (is_flat()) {
      BuildFlatRoof();
    } else {
      BuildPitchedRoof();
    }
    return {std::move(mesh_), sheet_.ToImage()};
  }

 private:
  bool is_flat() const { return house_.roof == Roof::kFlat; }
  Vector3d At(double x, double y, double z) const { return house_.frame.At(x, y, z); }

  void BuildSide(int side, const WindowStyle& style) {
    const auto index = static_cast<size_t>(side);
    const Frame wall = house_.Wall(side);
    const double width = house_.SideLength(side);
    Canvas& canvas = sheet_.canvas(index);
    const std::vector<Opening> openings = PlanOpenings(house_, side, style, rng_);
    const bool is_front = side == house_.front;
    if (is_front) {
      PaintHouseNumber(canvas, 0.5 * width + 0.7, 1.9, std::to_string(number_));
    } else if (rng_.Uniform() < 0.6) {
      PaintTraces(canvas, 0.3, 0.45 * width, rng_);
    }
    Facade facade(wall, canvas, sheet_.MaterialOf(index), openings, *style.stone, mesh_, rng_);
    for (const Opening& opening : openings) {
      facade.AddJoinery(opening, *style.joinery);
      if (opening.kind == Kind::kDoor) {
        mesh_.Box(wall, {opening.x - 0.2, -0.3, 0}, {opening.x + opening.width + 0.2, 0, 0.45},
                  m_.stone, rng_);
        continue;
      }
      facade.AddSill(opening, *style.stone);
      if (opening.kind == Kind::kShopWindow) {
        const double y = opening.y + opening.height + 0.2;
        mesh_.Box(wall, {opening.x, y, 0}, {opening.x + opening.width, y + 0.4, 0.07},
                  m_.signs[rng_.UniformIndex(4)], rng_, MeshBuilder::LowFace::kHidden);
      } else if (style.louvers != nullptr) {
        facade.AddShutters(opening, *style.louvers, 180, rng_.Uniform() < 0.2 ? 120 : 180);
      } else if (style.has_surrounds) {
        facade.AddSurround(opening, *style.stone, 0.12, 0.04);
      }
    }
    if (is_front) facade.AddSurround(openings[0], m_.stone, 0.16, 0.06);
    AddFoot(wall, width, house_.foot_m, m_.stone, mesh_, rng_);
    if (house_.roof == Roof::kGabled && side % 2 == 1) {
      const Material gable = sheet_.MaterialOf(side == 1 ? 6 : 7);
      const std::array<Corner, 3> corners{
          Corner{wall.At(0, house_.wall_m, 0), gable.At(0, 0)},
          Corner{wall.At(width, house_.wall_m, 0), gable.At(1, 0)},
          Corner{wall.At(0.5 * width, house_.wall_m + house_.rise_m, 0), gable.At(0.5, 1)}};
      mesh_.Polygon(corners, gable.texture);
    }
  }

  // A panel of the roof that starts at the eaves of side 0 or 2, or of the ends 1 and 3 of a hipped
  // one: its corners in that wall's frame as (along the wall, inward), eaves first.
  void AddPanel(int side, const std::vector<Vector2d>& corners) {
    const Frame wall = house_.Wall(side);
    const Material tiles = sheet_.MaterialOf(side < 2 ? 4 : 5);
    const double stretch = std::hypot(1, house_.slope());
    std::vector<Corner> upper;
    std::vector<Vector3d> lower;
    for (const Vector2d& c : corners) {
      const Vector3d at = wall.At(c.x(), house_.wall_m + house_.slope() * c.y(), -c.y());
      const Vector2d share((c.x() + kEaves) / tiles.size_m.x(),
                           (c.y() + kEaves) * stretch / tiles.size_m.y());
      upper.push_back({at, tiles.At(share.x(), std::clamp(share.y(), 0.0, 1.0))});
      lower.push_back(at - kSlab * Vector3d::UnitZ());
    }
    mesh_.Polygon(upper, tiles.texture);
    // What one sees from below: boards, and the edges.
    const auto quad = [&](const Vector3d& a, const Vector3d& b, const Vector3d& c,
                          const Vector3d& d) { mesh_.Quad(a, b, c, d, m_.dark_wood); };
    quad(lower.back(), lower[2], lower[1], lower[0]);
    const size_t edges = house_.roof == Roof::kGabled ? 4 : 1;
    for (size_t i = 0; i < edges; ++i) {
      if (i == 2) continue;  // the ridge
      const size_t next = (i + 1) % corners.size();
      quad(lower[i], lower[next], upper[next].position, upper[i].position);
    }
    const double length = house_.SideLength(side);
    const double low = house_.wall_m - house_.slope() * kEaves;
    mesh_.Box(wall, {-kVerge, low - 0.14, kEaves - 0.02},
              {length + kVerge, low - 0.02, kEaves + 0.1}, m_.copper, rng_);
  }

  void BuildPitchedRoof() {
    const double l = house_.length_m, w = house_.width_m, half = 0.5 * w;
    const bool is_hipped = house_.roof == Roof::kHipped;
    for (const int side : {0, 2}) {
      if (is_hipped) {
        AddPanel(side, {{-kEaves, -kEaves}, {l + kEaves, -kEaves}, {l - half, half}, {half, half}});
        AddPanel(side + 1, {{-kEaves, -kEaves}, {w + kEaves, -kEaves}, {half, half}});
      } else {
        AddPanel(side,
                 {{-kVerge, -kEaves}, {l + kVerge, -kEaves}, {l + kVerge, half}, {-kVerge, half}});
      }
      const double begin = is_hipped ? half : 1.0;
      const int dormers = static_cast<int>(rng_.UniformIndex(3));
      const double room = (l - 2 * begin) / std::max(1, dormers);
      for (int i = 0; i < dormers && room > 1.9; ++i)
        AddDormer(side, begin + (i + 0.5) * room - 0.8);
    }
    const double ridge = house_.wall_m + house_.rise_m;
    const double x = rng_.Uniform(0.4, 0.6) * l, y = half + rng_.Uniform(-0.8, 0.8);
    mesh_.Box(house_.frame, {x - 0.3, y - 0.3, house_.wall_m}, {x + 0.3, y + 0.3, ridge + 0.8},
              m_.terracotta, rng_);
    mesh_.Box(house_.frame, {x - 0.38, y - 0.38, ridge + 0.8}, {x + 0.38, y + 0.38, ridge + 0.92},
              m_.stone, rng_);
  }

  // A window under a flatter roof of its own.
  void AddDormer(int side, double x0) {
    constexpr double kWidth = 1.6, kHeight = 1.25, kSlope = 0.12, kBack = 0.5;
    const Frame wall = house_.Wall(side);
    const double low = house_.wall_m + house_.slope() * kBack, top = low + kHeight;
    const double meet = kBack + kHeight / (house_.slope() - kSlope);
    if (meet > 0.5 * house_.width_m - 0.1) return;
    const double x1 = x0 + kWidth, end = top + kSlope * (meet - kBack);
    const auto at = [&](double x, double y, double inward) { return wall.At(x, y, -inward); };
    const Material& cheek = m_.dark_wood;
    mesh_.Quad(at(x0, low, kBack), at(x1, low, kBack), at(x1, top, kBack), at(x0, top, kBack),
               m_.pale_stone);
    mesh_.Quad(at(x1, low, kBack), at(x1, end, meet), at(x1, end, meet), at(x1, top, kBack), cheek);
    mesh_.Quad(at(x0, end, meet), at(x0, low, kBack), at(x0, top, kBack), at(x0, end, meet), cheek);
    constexpr double kOut = 0.2;
    const double brow = top - kSlope * kOut;
    mesh_.Quad(at(x0 - 0.15, brow, kBack - kOut), at(x1 + 0.15, brow, kBack - kOut),
               at(x1 + 0.15, end, meet), at(x0 - 0.15, end, meet), m_.copper);
    const Frame front = wall.Moved(0, 0, -kBack);
    mesh_.Quad(front.At(x0 + 0.3, low + 0.2, 0.02), front.At(x0 + 1.3, low + 0.2, 0.02),
               front.At(x0 + 1.3, low + 1.1, 0.02), front.At(x0 + 0.3, low + 1.1, 0.02),
               m_.lamp_glass);
    mesh_.Box(front, {x0 + 0.22, low + 0.12, 0}, {x0 + 1.38, low + 0.2, 0.1}, m_.white_paint, rng_);
    for (const double x : {x0 + 0.22, x0 + 0.76, x0 + 1.3}) {
      mesh_.Box(front, {x, low + 0.2, 0}, {x + 0.08, low + 1.12, 0.08}, m_.white_paint, rng_);
    }
  }

  void BuildFlatRoof() {
    const Material gravel = sheet_.MaterialOf(4);
    const double l = house_.length_m, w = house_.width_m, top = house_.wall_m;
    // Around the light well in four pieces.
    const Rect well = house_.well.value_or(Rect{0.5 * l, 0.5 * w, 0.5 * l, 0.5 * w});
    for (const Rect& r : {Rect{0, 0, l, well.y0}, Rect{0, well.y1, l, w},
                          Rect{0, well.y0, well.x0, well.y1}, Rect{well.x1, well.y0, l, well.y1}}) {
      mesh_.Quad(At(r.x0, r.y0, top), At(r.x1, r.y0, top), At(r.x1, r.y1, top), At(r.x0, r.y1, top),
                 gravel.Part(r.x0 / l, r.y0 / w, r.x1 / l, r.y1 / w));
    }
    for (int side = 0; side < 4; ++side) {
      AddParapet(house_.Wall(side), house_.SideLength(side), top, m_.pale_stone, mesh_, rng_);
    }
    for (int i = 0; i < 3; ++i) {
      const double x = rng_.Uniform(0.8, 0.3 * l), y = rng_.Uniform(0.8, w - 1.6);
      mesh_.Box(house_.frame, {x, y, top}, {x + 0.6, y + 0.8, top + rng_.Uniform(0.4, 1.1)},
                m_.crates[0].Part(0.2, 0.05, 0.8, 0.2), rng_, MeshBuilder::LowFace::kHidden);
    }
    if (!house_.well) return;
    const std::array<Vector2d, 4> corners{Vector2d(well.x0, well.y0), Vector2d(well.x0, well.y1),
                                          Vector2d(well.x1, well.y1), Vector2d(well.x1, well.y0)};
    for (size_t i = 0; i < 4; ++i) {
      const Vector2d& a = corners[i];
      const Vector2d& b = corners[(i + 1) % 4];
      mesh_.Quad(At(a.x(), a.y(), -house_.foot_m), At(b.x(), b.y(), -house_.foot_m),
                 At(b.x(), b.y(), top), At(a.x(), a.y(), top), m_.pale_stone);
    }
  }

  const House& house_;
  const Materials& m_;
  int number_;
  Sheet sheet_;
  Rng& rng_;
  MeshBuilder mesh_;
};

}  // namespace

BuiltHouse BuildHouse(const House& house, const Materials& materials, int number, int texture,
                      Rng rng) {
  return HouseBuilder(house, materials, number, texture, rng).Build();
}

}  // namespace raylift::demo
