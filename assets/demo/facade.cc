#include "facade.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numbers>
#include <set>

#include "noise.h"
#include "panes.h"
#include <Eigen/Geometry>

namespace raylift::demo {

namespace {

constexpr int kArchSegments = 6;  // per half

// Points of the arch from the right spring over the top to the left one.
std::vector<Eigen::Vector2d> ArchPoints(const Opening& opening) {
  const double radius = 0.5 * opening.width;
  const Eigen::Vector2d center(opening.x + radius, opening.y + opening.height - radius);
  std::vector<Eigen::Vector2d> points;
  for (int k = 0; k <= 2 * kArchSegments; ++k) {
    const double angle = std::numbers::pi * k / (2 * kArchSegments);
    points.emplace_back(center + radius * Eigen::Vector2d(std::cos(angle), std::sin(angle)));
  }
  return points;
}

// Where rain runs off a sill, and dust settles under it.
void PaintStains(Canvas& canvas, const Opening& opening, uint32_t seed) {
  const double bottom = std::max(0.0, opening.y - 1.3);
  canvas.Paint({opening.x - 0.15, bottom, opening.x + opening.width + 0.15, opening.y},
               [&](double x, double y, Color& texel) {
                 const double streak = FractalNoise(14 * x, 0.7 * y, 3, seed);
                 const double fade = (y - bottom) / (opening.y - bottom);
                 texel = Mix(texel, {0.25f, 0.23f, 0.20f}, 2.2 * fade * (streak - 0.45));
               });
}

// The opening was painted as a rectangle; what is outside its arch is wall.
void KeepWallAboveArch(Canvas& canvas, const Canvas& wall, const Opening& opening) {
  const double radius = 0.5 * opening.width + 0.02;
  const double center_x = opening.x + 0.5 * opening.width;
  const double center_y = opening.y + opening.height - 0.5 * opening.width;
  canvas.Paint(opening.area(), [&](double x, double y, Color& texel) {
    if (y > center_y && std::hypot(x - center_x, y - center_y) > radius) texel = wall.At(x, y);
  });
}

}  // namespace

Facade::Facade(const Frame& wall, Canvas& canvas, const Material& sheet,
               const std::vector<Opening>& openings, const Material& reveal, MeshBuilder& mesh,
               Rng rng)
    : wall_(wall), sheet_(sheet), mesh_(mesh), rng_(rng) {
  for (const Opening& opening : openings) {
    if (opening.y > 0.5) PaintStains(canvas, opening, static_cast<uint32_t>(rng_.NextBits()));
  }
  for (const Opening& opening : openings) {
    const Canvas wall_alone = canvas;
    PaintOpening(canvas, opening, rng_);
    if (opening.top == Opening::Top::kArched) KeepWallAboveArch(canvas, wall_alone, opening);
  }
  BuildWall(openings);
  for (const Opening& opening : openings) {
    if (opening.top == Opening::Top::kArched) BuildArchCorners(opening);
    BuildReveals(opening, reveal);
  }
}

Corner Facade::At(double x, double y, double z) const {
  return {wall_.At(x, y, z), sheet_.At(x / sheet_.size_m.x(), y / sheet_.size_m.y())};
}

void Facade::BuildWall(const std::vector<Opening>& openings) {
  // Cut along the edges of all openings through the whole wall, so that no corner lies inside
  // another piece's edge and the wall has no cracks.
  std::set<double> xs{0, sheet_.size_m.x()}, ys{0, sheet_.size_m.y()};
  for (const Opening& opening : openings) {
    xs.insert({opening.x, opening.x + opening.width});
    ys.insert({opening.y, opening.y + opening.height});
    if (opening.top == Opening::Top::kArched) {
      xs.insert(opening.x + 0.5 * opening.width);
      ys.insert(opening.y + opening.height - 0.5 * opening.width);
    }
  }
  for (auto y = ys.begin(); std::next(y) != ys.end(); ++y) {
    for (auto x = xs.begin(); std::next(x) != xs.end(); ++x) {
      const double x1 = *std::next(x), y1 = *std::next(y);
      bool is_open = false;
      for (const Opening& opening : openings) {
        const Rect area = opening.area();
        const double mid_x = 0.5 * (*x + x1), mid_y = 0.5 * (*y + y1);
        is_open |= mid_x > area.x0 && mid_x < area.x1 && mid_y > area.y0 && mid_y < area.y1;
      }
      if (is_open) continue;
      const std::array<Corner, 4> corners{At(*x, *y, 0), At(x1, *y, 0), At(x1, y1, 0),
                                          At(*x, y1, 0)};
      mesh_.Polygon(corners, sheet_.texture);
    }
  }
}

void Facade::BuildArchCorners(const Opening& opening) {
  const std::vector<Eigen::Vector2d> arch = ArchPoints(opening);
  const double top = opening.y + opening.height;
  for (int k = 0; k < 2 * kArchSegments; ++k) {
    const double corner_x = k < kArchSegments ? opening.x + opening.width : opening.x;
    const std::array<Corner, 3> corners{At(corner_x, top, 0),
                                        At(arch[k + 1].x(), arch[k + 1].y(), 0),
                                        At(arch[k].x(), arch[k].y(), 0)};
    mesh_.Polygon(corners, sheet_.texture);
  }
}

void Facade::BuildReveals(const Opening& opening, const Material& reveal) {
  const Rect a = opening.area();
  const double back = -opening.recess_m;
  const bool is_arched = opening.top == Opening::Top::kArched;
  const double side_top = is_arched ? a.y1 - 0.5 * opening.width : a.y1;
  const auto quad = [&](const Eigen::Vector2d& p, const Eigen::Vector2d& q, double zp, double zq,
                        double length) {
    mesh_.Quad(wall_.At(p.x(), p.y(), zp), wall_.At(p.x(), p.y(), zq), wall_.At(q.x(), q.y(), zq),
               wall_.At(q.x(), q.y(), zp), reveal.Piece(opening.recess_m, length, rng_));
  };
  const Eigen::Vector2d lower_left(a.x0, a.y0), lower_right(a.x1, a.y0);
  quad(lower_left, {a.x0, side_top}, 0, back, side_top - a.y0);
  quad(lower_right, {a.x1, side_top}, back, 0, side_top - a.y0);
  quad(lower_right, lower_left, 0, back, a.width());
  if (is_arched) {
    const std::vector<Eigen::Vector2d> arch = ArchPoints(opening);
    for (size_t k = 0; k + 1 < arch.size(); ++k) {
      quad(arch[k], arch[k + 1], back, 0, (arch[k + 1] - arch[k]).norm());
    }
  } else {
    quad({a.x1, a.y1}, {a.x0, a.y1}, back, 0, a.width());
  }
  const std::array<Corner, 4> pane{At(a.x0, a.y0, back), At(a.x1, a.y0, back), At(a.x1, a.y1, back),
                                   At(a.x0, a.y1, back)};
  mesh_.Polygon(pane, sheet_.texture);
}

void Facade::AddJoinery(const Opening& opening, const Material& paint) {
  const Rect a = opening.area();
  const double back = -opening.recess_m;
  const auto bar = [&](double x0, double y0, double x1, double y1, double out) {
    mesh_.Box(wall_, {x0, y0, back}, {x1, y1, back + out}, paint, rng_,
              MeshBuilder::LowFace::kHidden);
  };
  constexpr double kFrame = 0.07, kBar = 0.035;
  bar(a.x0, a.y0, a.x0 + kFrame, a.y1, 0.06);
  bar(a.x1 - kFrame, a.y0, a.x1, a.y1, 0.06);
  bar(a.x0 + kFrame, a.y1 - kFrame, a.x1 - kFrame, a.y1, 0.06);
  if (opening.kind == Opening::Kind::kDoor) return;
  bar(a.x0 + kFrame, a.y0, a.x1 - kFrame, a.y0 + kFrame, 0.06);
  const double mid = 0.5 * (a.x0 + a.x1);
  bar(mid - kBar, a.y0 + kFrame, mid + kBar, a.y1 - kFrame, 0.05);
  const double transom = a.y0 + 0.68 * a.height();
  bar(a.x0 + kFrame, transom - kBar, mid - kBar, transom + kBar, 0.04);
  bar(mid + kBar, transom - kBar, a.x1 - kFrame, transom + kBar, 0.04);
}

void Facade::AddSill(const Opening& opening, const Material& stone) {
  mesh_.Box(wall_, {opening.x - 0.1, opening.y - 0.09, 0},
            {opening.x + opening.width + 0.1, opening.y, 0.13}, stone, rng_,
            MeshBuilder::LowFace::kHidden);
}

void Facade::AddSurround(const Opening& opening, const Material& stone, double width_m,
                         double out_m) {
  const Rect a = opening.area();
  const auto block = [&](double x0, double y0, double x1, double y1, double out) {
    mesh_.Box(wall_, {x0, y0, 0}, {x1, y1, out}, stone, rng_, MeshBuilder::LowFace::kHidden);
  };
  const bool is_arched = opening.top == Opening::Top::kArched;
  const double side_top = is_arched ? a.y1 - 0.5 * opening.width : a.y1;
  block(a.x0 - width_m, a.y0, a.x0, side_top, out_m);
  block(a.x1, a.y0, a.x1 + width_m, side_top, out_m);
  if (!is_arched) {
    block(a.x0 - width_m - 0.04, a.y1, a.x1 + width_m + 0.04, a.y1 + 1.3 * width_m, out_m + 0.03);
    return;
  }
  // Imposts and a keystone are enough to make an arch.
  block(a.x0 - width_m - 0.03, side_top, a.x0 + 0.03, side_top + 0.14, out_m + 0.03);
  block(a.x1 - 0.03, side_top, a.x1 + width_m + 0.03, side_top + 0.14, out_m + 0.03);
  const double mid = 0.5 * (a.x0 + a.x1);
  block(mid - 0.13, a.y1 - 0.06, mid + 0.13, a.y1 + 0.32, out_m + 0.04);
}

void Facade::AddShutters(const Opening& window, const Material& louvers, double left_deg,
                         double right_deg) {
  const double width = 0.5 * window.width;
  const auto shutter = [&](double hinge_x, double angle_deg, double sign) {
    // Turned about the vertical hinge; at 180 degrees flat on the wall beside the window.
    const double angle = angle_deg * std::numbers::pi / 180;
    Frame frame = wall_.Moved(hinge_x, window.y, 0.02);
    frame.x = sign * std::cos(angle) * wall_.x + std::sin(angle) * wall_.z;
    frame.z = frame.x.cross(frame.y);
    mesh_.Box(frame, {0, 0, sign > 0 ? -0.04 : 0.0}, {width, window.height, sign > 0 ? 0.0 : 0.04},
              louvers, rng_);
  };
  shutter(window.x, left_deg, 1);
  shutter(window.x + window.width, right_deg, -1);
}

void Facade::AddBand(double x0, double x1, double y0, double y1, double out_m,
                     const Material& material) {
  // In pieces, as masons do, so that the pattern is not stretched.
  const int pieces = std::max(1, static_cast<int>(std::lround((x1 - x0) / 1.3)));
  for (int i = 0; i < pieces; ++i) {
    mesh_.Box(wall_, {std::lerp(x0, x1, static_cast<double>(i) / pieces), y0, 0},
              {std::lerp(x0, x1, (i + 1.0) / pieces), y1, out_m}, material, rng_,
              MeshBuilder::LowFace::kHidden);
  }
}

void Facade::AddRoof(double eaves_m, double depth_m, double rise_m, const Material& tiles,
                     const Material& gutter, const Material& soffit) {
  const double width = sheet_.size_m.x(), top = sheet_.size_m.y();
  const double slope = rise_m / depth_m;
  const double low = top - slope * eaves_m + 0.12;
  const int pieces = static_cast<int>(std::lround(width / 4));
  for (int i = 0; i < pieces; ++i) {
    const double x0 = width * i / pieces, x1 = width * (i + 1) / pieces;
    const Material part = tiles.Part(0, 0, 1, std::min(1.0, std::hypot(depth_m, rise_m) / 2.4));
    mesh_.Quad(wall_.At(x0, low, eaves_m), wall_.At(x1, low, eaves_m),
               wall_.At(x1, low + slope * (depth_m + eaves_m), -depth_m),
               wall_.At(x0, low + slope * (depth_m + eaves_m), -depth_m), part);
    mesh_.Box(wall_, {x0, low - 0.12, eaves_m - 0.04}, {x1, low, eaves_m + 0.08}, gutter, rng_);
    mesh_.Quad(wall_.At(x0, low - 0.06, 0), wall_.At(x1, low - 0.06, 0),
               wall_.At(x1, low - 0.06, eaves_m), wall_.At(x0, low - 0.06, eaves_m), soffit);
  }
}

}  // namespace raylift::demo
