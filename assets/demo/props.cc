#include "props.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

namespace raylift::demo {

namespace {

using Profile = std::vector<Eigen::Vector2d>;

// A leaf: a small quad at a random tilt about the direction it grows in.
void AddLeaf(PropContext& c, const Eigen::Vector3d& position, const Eigen::Vector3d& outward,
             double size_m, const Material& material) {
  const Eigen::Vector3d normal =
      (outward.normalized() +
       0.8 * Eigen::Vector3d(c.rng.Uniform(-1, 1), c.rng.Uniform(-1, 1), c.rng.Uniform(-1, 1)))
          .normalized();
  const Eigen::Vector3d side = normal.unitOrthogonal();
  const Eigen::Vector3d other = normal.cross(side);
  const double turn = c.rng.Uniform(0, 2 * std::numbers::pi);
  const double size = size_m * c.rng.Uniform(0.7, 1.3);
  const Eigen::Vector3d a = 0.5 * size * (std::cos(turn) * side + std::sin(turn) * other);
  const Eigen::Vector3d b = 0.32 * size * (std::cos(turn) * other - std::sin(turn) * side);
  c.mesh.Quad(position - a, position + 0.2 * a - b, position + a, position + 0.2 * a + b, material);
}

void AddLegs(PropContext& c, const Frame& frame, double half_x, double half_y, double height,
             double radius, const Material& material) {
  for (double x : {-half_x, half_x}) {
    for (double y : {-half_y, half_y}) {
      c.mesh.Box(frame, {x - radius, y - radius, 0}, {x + radius, y + radius, height}, material,
                 c.rng, MeshBuilder::LowFace::kHidden);
    }
  }
}

void AddWheel(PropContext& c, const Eigen::Vector3d& center, const Eigen::Vector3d& axis,
              double radius) {
  const Eigen::Vector3d x = axis.unitOrthogonal();
  const Frame frame{center, x, axis.cross(x), axis};
  const Profile rim{{radius - 0.06, -0.03},
                    {radius, -0.03},
                    {radius, 0.03},
                    {radius - 0.06, 0.03},
                    {radius - 0.06, -0.03}};
  c.mesh.Turned(frame, rim, 20, c.materials.dark_wood);
  for (int k = 0; k < 8; ++k) {
    const double a = std::numbers::pi * k / 4;
    c.mesh.Tube(center, frame.At((radius - 0.03) * std::cos(a), (radius - 0.03) * std::sin(a), 0),
                0.022, 4, c.materials.wood);
  }
}

}  // namespace

void AddFountain(PropContext& c, const Frame& frame) {
  const Material& stone = c.materials.stone;
  const Profile basin{{1.75, 0},    {1.75, 0.16}, {1.55, 0.18}, {1.50, 0.50},
                      {1.62, 0.56}, {1.62, 0.66}, {1.38, 0.66}, {1.36, 0.40}};
  c.mesh.Turned(frame, basin, 8, stone);
  for (int k = 0; k < 8; ++k) {
    const double a0 = std::numbers::pi * k / 4, a1 = a0 + std::numbers::pi / 4;
    c.mesh.Quad(frame.At(0.1 * std::cos(a0), 0.1 * std::sin(a0), 0.5),
                frame.At(1.4 * std::cos(a0), 1.4 * std::sin(a0), 0.5),
                frame.At(1.4 * std::cos(a1), 1.4 * std::sin(a1), 0.5),
                frame.At(0.1 * std::cos(a1), 0.1 * std::sin(a1), 0.5),
                c.materials.water.Piece(1.3, 1.0, c.rng));
  }
  const Profile column{{0.42, 0.3}, {0.42, 0.6},  {0.24, 0.72}, {0.18, 1.2},  {0.22, 1.35},
                       {0.62, 1.5}, {0.78, 1.62}, {0.78, 1.70}, {0.66, 1.70}, {0.1, 1.58}};
  c.mesh.Turned(frame, column, 16, c.materials.pale_stone);
  // A robed figure holding a ball.
  const Frame figure = frame.Moved(0, 0, 1.55);
  const Profile robe{{0.26, 0},    {0.26, 0.12}, {0.17, 0.14}, {0.20, 0.2},  {0.15, 0.55},
                     {0.12, 0.72}, {0.17, 0.92}, {0.16, 1.02}, {0.05, 1.10}, {0.05, 1.14}};
  c.mesh.Turned(figure, robe, 12, c.materials.copper);
  const auto ball = [&](const Frame& center, double radius) {
    Profile profile;
    for (int k = 0; k <= 6; ++k) {
      const double a = std::numbers::pi * (k / 6.0 - 0.5);
      profile.emplace_back(std::max(0.0, radius * std::cos(a)), radius * std::sin(a));
    }
    c.mesh.Turned(center, profile, 10, c.materials.copper);
  };
  ball(figure.Moved(0, 0, 1.23), 0.11);
  c.mesh.Tube(figure.At(0.12, 0, 0.95), figure.At(0.34, 0.05, 1.22), 0.045, 6, c.materials.copper);
  c.mesh.Tube(figure.At(-0.12, 0, 0.95), figure.At(-0.26, 0.12, 0.68), 0.045, 6,
              c.materials.copper);
  ball(figure.Moved(0.36, 0.05, 1.33), 0.12);
}

void AddCrate(PropContext& c, const Frame& frame, double size_m, size_t which) {
  Material face = c.materials.crates[which % c.materials.crates.size()];
  face.size_m = {size_m, size_m};
  const double half = 0.5 * size_m;
  c.mesh.Box(frame, {-half, -half, 0}, {half, half, size_m}, face, c.rng,
             MeshBuilder::LowFace::kHidden);
}

void AddBarrel(PropContext& c, const Frame& frame, double height_m) {
  Profile profile;
  for (int k = 0; k <= 8; ++k) {
    const double t = k / 8.0;
    profile.emplace_back(height_m * (0.29 + 0.08 * std::sin(std::numbers::pi * t)), t * height_m);
  }
  c.mesh.Turned(frame, profile, 16, c.materials.barrel);
  const Profile lid{{0.29 * height_m, height_m},
                    {0.26 * height_m, height_m},
                    {0.26 * height_m, 0.96 * height_m},
                    {0, 0.96 * height_m}};
  c.mesh.Turned(frame, lid, 16, c.materials.dark_wood);
}

void AddBench(PropContext& c, const Frame& frame) {
  for (double x : {-0.75, 0.75}) {
    c.mesh.Box(frame, {x - 0.05, -0.22, 0}, {x + 0.05, 0.22, 0.42}, c.materials.iron, c.rng,
               MeshBuilder::LowFace::kHidden);
    c.mesh.Box(frame, {x - 0.04, 0.20, 0.42}, {x + 0.04, 0.26, 0.9}, c.materials.iron, c.rng);
  }
  for (int slat = 0; slat < 4; ++slat) {
    const double y = -0.24 + 0.12 * slat;
    c.mesh.Box(frame, {-0.95, y, 0.42}, {0.95, y + 0.10, 0.46}, c.materials.green_paint, c.rng);
  }
  for (double z : {0.56, 0.70, 0.84}) {
    c.mesh.Box(frame, {-0.95, 0.17, z}, {0.95, 0.20, z + 0.10}, c.materials.green_paint, c.rng);
  }
}

void AddTable(PropContext& c, const Frame& frame) {
  const Profile foot{{0.26, 0}, {0.26, 0.03}, {0.035, 0.05}, {0.035, 0.72}};
  c.mesh.Turned(frame, foot, 10, c.materials.iron);
  const Profile top{{0.40, 0.72}, {0.40, 0.75}, {0, 0.75}};
  c.mesh.Turned(frame, top, 16, c.materials.pale_stone);
  const Profile jug{{0.05, 0.75}, {0.075, 0.82}, {0.04, 0.92}, {0.055, 0.96}};
  c.mesh.Turned(frame.Moved(0.08, 0.1, 0), jug, 8, c.materials.terracotta);
}

void AddChair(PropContext& c, const Frame& frame, const Material& paint) {
  AddLegs(c, frame, 0.18, 0.18, 0.44, 0.018, c.materials.iron);
  c.mesh.Box(frame, {-0.21, -0.21, 0.44}, {0.21, 0.21, 0.47}, paint, c.rng);
  for (double x : {-0.19, 0.19}) {
    c.mesh.Tube(frame.At(x, 0.19, 0.47), frame.At(x, 0.25, 0.88), 0.016, 5, c.materials.iron);
  }
  c.mesh.Box(frame, {-0.20, 0.215, 0.66}, {0.20, 0.24, 0.86}, paint, c.rng);
}

void AddPlanter(PropContext& c, const Frame& frame, double length_m) {
  const double half = 0.5 * length_m;
  c.mesh.Box(frame, {-half, -0.3, 0}, {half, 0.3, 0.5}, c.materials.dark_wood, c.rng,
             MeshBuilder::LowFace::kHidden);
  c.mesh.Quad(frame.At(-half + 0.04, -0.26, 0.502), frame.At(half - 0.04, -0.26, 0.502),
              frame.At(half - 0.04, 0.26, 0.502), frame.At(-half + 0.04, 0.26, 0.502),
              c.materials.soil);
  AddLeaves(c, frame.Moved(0, 0, 0.68), {0.95 * half, 0.30, 0.34}, static_cast<int>(110 * length_m),
            0.17, c.materials.leaves);
  AddLeaves(c, frame.Moved(0, 0, 0.74), {0.95 * half, 0.32, 0.34}, static_cast<int>(22 * length_m),
            0.09, c.materials.flowers);
}

void AddPot(PropContext& c, const Frame& frame, double height_m) {
  const double h = height_m;
  const Profile profile{{0.30 * h, 0}, {0.45 * h, 0.85 * h}, {0.50 * h, 0.86 * h}, {0.50 * h, h},
                        {0.42 * h, h}, {0.42 * h, 0.9 * h},  {0, 0.9 * h}};
  c.mesh.Turned(frame, profile, 14, c.materials.terracotta);
  AddLeaves(c, frame.Moved(0, 0, 1.35 * h), {0.6 * h, 0.6 * h, 0.6 * h}, 55, 0.18,
            c.materials.leaves);
}

void AddTree(PropContext& c, const Frame& frame, double height_m, int leaves) {
  const double h = height_m;
  const Profile trunk{{0.17, 0}, {0.12, 0.25}, {0.10, 0.55 * h}};
  c.mesh.Turned(frame, trunk, 9, c.materials.bark);
  for (int k = 0; k < 6; ++k) {
    const double a = 2 * std::numbers::pi * k / 6 + 0.4, low = (0.42 + 0.03 * k) * h;
    c.mesh.Tube(frame.At(0, 0, low),
                frame.At(0.20 * h * std::cos(a), 0.20 * h * std::sin(a), low + 0.2 * h), 0.04, 5,
                c.materials.bark);
  }
  // A crown of a few overlapping balls.
  for (int k = 0; k < 6; ++k) {
    const double a = 2 * std::numbers::pi * k / 5, reach = k == 5 ? 0 : 0.16 * h;
    AddLeaves(c, frame.Moved(reach * std::cos(a), reach * std::sin(a), (0.70 + 0.05 * (k % 3)) * h),
              {0.17 * h, 0.17 * h, 0.15 * h}, leaves / 6, 0.22, c.materials.leaves);
  }
}

void AddMenuBoard(PropContext& c, const Frame& frame) {
  const Material& board = c.materials.menu_board;
  const auto side = [&](double sign) {
    const double foot = -sign * 0.25, x = sign * 0.3;
    c.mesh.Quad(frame.At(-x, foot, 0), frame.At(x, foot, 0), frame.At(x, -sign * 0.02, 1.0),
                frame.At(-x, -sign * 0.02, 1.0), board);
  };
  side(1);
  side(-1);
}

void AddLampPost(PropContext& c, const Frame& frame) {
  const Profile post{{0.16, 0}, {0.16, 0.25}, {0.07, 0.32}, {0.05, 2.9}, {0.09, 2.95}, {0.04, 3.0}};
  c.mesh.Turned(frame, post, 10, c.materials.iron);
  const Profile glass{{0.10, 3.0}, {0.17, 3.36}};
  c.mesh.Turned(frame, glass, 6, c.materials.lamp_glass);
  const Profile hat{{0.22, 3.36}, {0.20, 3.40}, {0.05, 3.52}, {0.03, 3.62}, {0, 3.63}};
  c.mesh.Turned(frame, hat, 6, c.materials.iron);
}

void AddCart(PropContext& c, const Frame& frame) {
  c.mesh.Box(frame, {-0.85, -0.45, 0.52}, {0.85, 0.45, 0.58}, c.materials.wood, c.rng);
  for (double y : {-0.45, 0.42}) {
    c.mesh.Box(frame, {-0.85, y, 0.58}, {0.85, y + 0.03, 0.84}, c.materials.blue_paint, c.rng);
  }
  for (double x : {-0.85, 0.82}) {
    c.mesh.Box(frame, {x, -0.42, 0.58}, {x + 0.03, 0.42, 0.84}, c.materials.blue_paint, c.rng);
  }
  for (double y : {-0.56, 0.56}) AddWheel(c, frame.At(0, y, 0.45), frame.y, 0.45);
  for (double y : {-0.3, 0.3})
    c.mesh.Tube(frame.At(0.8, y, 0.55), frame.At(1.7, y, 0.12), 0.03, 5, c.materials.dark_wood);
  AddLeaves(c, frame.Moved(-0.1, 0, 0.78), {0.6, 0.36, 0.2}, 70, 0.14, c.materials.flowers);
  AddLeaves(c, frame.Moved(-0.1, 0, 0.72), {0.66, 0.38, 0.22}, 110, 0.16, c.materials.leaves);
}

void AddLadder(PropContext& c, const Frame& frame, double height_m) {
  const double lean = 0.28 * height_m;
  for (double x : {-0.22, 0.22}) {
    c.mesh.Tube(frame.At(x, 0, 0), frame.At(x, lean, height_m), 0.03, 5, c.materials.wood);
  }
  for (double t = 0.08; t < 1; t += 0.3 / height_m) {
    c.mesh.Tube(frame.At(-0.22, lean * t, height_m * t), frame.At(0.22, lean * t, height_m * t),
                0.018, 4, c.materials.wood);
  }
}

void AddParasol(PropContext& c, const Frame& frame) {
  c.mesh.Tube(frame.At(0, 0, 0), frame.At(0, 0, 2.5), 0.03, 6, c.materials.white_paint);
  const Profile roof{{1.25, 1.98}, {0.02, 2.48}};
  c.mesh.Turned(frame, roof, 10, c.materials.parasol);
}

void AddCar(PropContext& c, const Frame& frame, const Material& paint, const Material& glass) {
  const Material& tire = c.materials.iron;
  c.mesh.Box(frame, {-2.1, -0.86, 0.3}, {2.1, 0.86, 0.62}, paint, c.rng);
  // The body's upper half and the cabin taper off upwards.
  const auto tapered = [&](double x0, double x1, double half_y, double z0, double z1, double in,
                           const Material& sides) {
    const auto corner = [&](int i, bool is_high) {
      const double inset = is_high ? in : 0;
      const bool is_front = i == 1 || i == 2, is_left = i >= 2;
      return frame.At(is_front ? x1 - 1.3 * inset : x0 + inset,
                      (is_left ? 1 : -1) * (half_y - 0.5 * inset), is_high ? z1 : z0);
    };
    for (int i = 0; i < 4; ++i) {
      c.mesh.Quad(corner(i, false), corner((i + 1) % 4, false), corner((i + 1) % 4, true),
                  corner(i, true), sides);
    }
    c.mesh.Quad(corner(0, true), corner(1, true), corner(2, true), corner(3, true), paint);
  };
  tapered(-2.1, 2.1, 0.86, 0.62, 0.88, 0.1, paint);
  tapered(-1.9, 0.95, 0.78, 0.88, 1.42, 0.45, glass);
  for (double x : {-1.35, 1.35}) {
    for (double y : {-0.78, 0.78}) {
      const Frame wheel{frame.At(x, y, 0.32), frame.x, -frame.z, frame.y};
      const Profile profile{{0.02, -0.1}, {0.32, -0.1}, {0.32, 0.1}, {0.02, 0.1}};
      c.mesh.Turned(wheel, profile, 14, tire);
    }
  }
  for (double y : {-0.8, 0.5}) {
    c.mesh.Box(frame, {2.08, y, 0.62}, {2.12, y + 0.3, 0.74}, c.materials.lamp_glass, c.rng);
    c.mesh.Box(frame, {-2.12, y, 0.62}, {-2.08, y + 0.3, 0.74}, c.materials.red_paint, c.rng);
  }
}

void AddWashingLine(PropContext& c, const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const Eigen::Vector3d along = to - from;
  const auto at = [&](double t) {
    return Eigen::Vector3d(from + t * along - 1.0 * t * (1 - t) * Eigen::Vector3d::UnitZ());
  };
  for (int k = 0; k < 10; ++k)
    c.mesh.Tube(at(k / 10.0), at((k + 1) / 10.0), 0.008, 4, c.materials.wood);
  const double step = 1.15 / along.norm();
  size_t which = c.rng.UniformIndex(6);
  for (double t = 0.12; t < 0.88; t += step) {
    const Material& cloth = c.materials.cloths[which++ % c.materials.cloths.size()];
    const double width = c.rng.Uniform(0.5, 0.85) / along.norm(), drop = c.rng.Uniform(0.55, 0.95);
    const Eigen::Vector3d fall(0.06 * along.y() / along.norm(), -0.06 * along.x() / along.norm(),
                               -drop);
    c.mesh.Quad(at(t) + fall, at(t + width) + fall, at(t + width), at(t), cloth);
  }
}

void AddLeaves(PropContext& c, const Frame& frame, const Eigen::Vector3d& radii, int count,
               double leaf_m, const std::vector<Material>& kinds) {
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d direction =
        Eigen::Vector3d(c.rng.Normal(), c.rng.Normal(), c.rng.Normal()).normalized();
    const Eigen::Vector3d p = direction.cwiseProduct(radii) * std::sqrt(c.rng.Uniform(0.35, 1));
    AddLeaf(c, frame.At(p.x(), p.y(), p.z()), frame.At(p.x(), p.y(), p.z() + 0.2) - frame.origin,
            leaf_m, kinds[c.rng.UniformIndex(static_cast<uint32_t>(kinds.size()))]);
  }
}

void AddIvy(PropContext& c, const Frame& wall, double x0, double x1, double top_m, int count) {
  for (int i = 0; i < count; ++i) {
    const double up = std::pow(c.rng.Uniform(), 1.3);
    const double spread = 1 - 0.45 * up;
    const double x = 0.5 * (x0 + x1) + 0.5 * (x1 - x0) * spread * c.rng.Uniform(-1, 1);
    AddLeaf(
        c, wall.At(x, up * top_m * c.rng.Uniform(0.8, 1), c.rng.Uniform(0.03, 0.13)),
        wall.z + 0.3 * wall.y, 0.20,
        c.materials.leaves[c.rng.UniformIndex(static_cast<uint32_t>(c.materials.leaves.size()))]);
  }
}

}  // namespace raylift::demo
