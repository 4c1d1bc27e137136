#include "town.h"

#include <array>
#include <cmath>
#include <numbers>

#include "atlas.h"
#include "house.h"
#include "noise.h"
#include "photograph.h"
#include "props.h"
#include "surfaces.h"
#include "town_sheets.h"
#include "viewpoints.h"

#include "raylift/base/parallel.h"

namespace raylift::demo {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

enum Texture { kGround, kThings, kFirstHouse };

constexpr double kGroundPxPerM = 12;

// What the town has beside the materials of the courtyard.
struct TownMaterials {
  std::vector<Material> car_paints;
  Material glass, field;
};

TownMaterials PaintTownMaterials(Atlas& atlas) {
  TownMaterials m;
  for (const Color& base :
       {Color(0.75f, 0.76f, 0.78f), Color(0.62f, 0.12f, 0.12f), Color(0.14f, 0.24f, 0.46f),
        Color(0.10f, 0.10f, 0.11f), Color(0.88f, 0.87f, 0.84f), Color(0.24f, 0.36f, 0.28f)}) {
    m.car_paints.push_back(atlas.Add(1.2, 0.5, [&](double x, double y) {
      return Color(base * static_cast<float>(0.9 + 0.2 * FractalNoise(2 * x, 4 * y, 2, 801)));
    }));
  }
  m.glass = atlas.Add(1.0, 0.5, [](double x, double y) {
    return Mix({0.06f, 0.07f, 0.08f}, {0.42f, 0.50f, 0.56f},
               FractalNoise(3 * x, 3 * y, 3, 802) - 0.2);
  });
  m.field = atlas.Add(3, 1.5, [](double x, double y) {
    return Mix({0.40f, 0.44f, 0.22f}, {0.60f, 0.56f, 0.34f}, 2 * FractalNoise(x, y, 5, 803) - 0.5);
  });
  return m;
}

void AddGround(const Town& town, MeshBuilder& mesh) {
  for (const auto& triangle : town.Ground()) {
    std::array<Corner, 3> corners;
    for (size_t i = 0; i < 3; ++i) {
      const Vector3d& p = triangle[i];
      corners[i] = {p, {p.x() / Town::kWidth, p.y() / Town::kDepth}};
    }
    mesh.Polygon(corners, kGround);
  }
}

void AddFields(const Town& town, const Material& field, MeshBuilder& mesh, Rng& rng) {
  constexpr double kCell = 10, kReach = 250;
  for (double x = -kReach; x < Town::kWidth + kReach; x += kCell) {
    for (double y = -kReach; y < Town::kDepth + kReach; y += kCell) {
      const bool is_town = x >= 0 && y >= 0 && x < Town::kWidth && y < Town::kDepth;
      if (is_town) continue;
      mesh.Quad(town.OnGround(x, y), town.OnGround(x + kCell, y),
                town.OnGround(x + kCell, y + kCell), town.OnGround(x, y + kCell),
                field.Piece(0.5, 0.5, rng));
    }
  }
}

void AddObjects(const Town& town, const TownMaterials& town_materials, PropContext& c) {
  for (int tree = 0; tree < 26;) {
    const Vector2d at(c.rng.Uniform(3, Town::kWidth - 3), c.rng.Uniform(3, Town::kDepth - 3));
    const double height = c.rng.Uniform(3.5, 7.5);
    if (!town.IsFree(at, 0.3 * height) ||
        town.DistanceToStreet(at.x(), at.y()) < Town::kStreetHalfWidth + 0.6) {
      continue;
    }
    AddTree(c, UprightFrame(town.OnGround(at.x(), at.y()), c.rng.Uniform(0, 360)), height,
            static_cast<int>(240 * height));
    ++tree;
  }
  for (int street = 0; street < Town::kStreets; ++street) {
    for (double along = c.rng.Uniform(4, 14); along < Town::StreetLength(street) - 6;
         along += c.rng.Uniform(6, 24)) {
      const Town::Place place = town.OnStreet(street, along);
      const double side = c.rng.Uniform() < 0.5 ? -1 : 1;
      const Vector2d at = place.at + 2.2 * side * Vector2d(place.along.y(), -place.along.x());
      const double heading = std::atan2(place.along.y(), place.along.x()) * 180 / std::numbers::pi;
      const auto paints = static_cast<uint32_t>(town_materials.car_paints.size());
      AddCar(c, UprightFrame(town.OnGround(at.x(), at.y()), heading + (side < 0 ? 180 : 0)),
             town_materials.car_paints[c.rng.UniformIndex(paints)], town_materials.glass);
    }
  }
  for (int i = 0; i < 12;) {
    const Vector2d at(c.rng.Uniform(3, Town::kWidth - 3), c.rng.Uniform(3, Town::kDepth - 3));
    const double street = town.DistanceToStreet(at.x(), at.y());
    if (!town.IsFree(at, 1.4) || street < Town::kStreetHalfWidth + 0.4 || street > 12) continue;
    const Frame frame = UprightFrame(town.OnGround(at.x(), at.y()), c.rng.Uniform(0, 360));
    if (i % 3 == 0) AddParasol(c, frame);
    if (i % 3 == 1) AddMenuBoard(c, frame);
    if (i % 3 == 2) AddCrate(c, frame, c.rng.Uniform(0.6, 1), static_cast<size_t>(i));
    ++i;
  }
}

// How much of what a view shows is the map, and how near the nearest of it.
struct Sight {
  double share = 0, nearest = 1e9;
};
Sight SightOf(const RayCaster& caster, const PosedImage& view) {
  constexpr int kSide = 12;
  const PixelGrid grid = GridOf(view.camera, view.cam_from_world);
  std::vector<Ray> rays;
  for (int i = 0; i < kSide * kSide; ++i) {
    rays.push_back(grid.ray({(i % kSide + 0.5) * grid.width_px / kSide,
                             (static_cast<int>(i / kSide) + 0.5) * grid.height_px / kSide}));
  }
  Sight sight;
  for (const auto& hit : caster.Cast(rays)) {
    if (!hit) continue;
    sight.share += 1.0 / (kSide * kSide);
    sight.nearest = std::min(sight.nearest, hit->ray_t);
  }
  return sight;
}

}  // namespace

TownScene BuildTown(const Town& town, uint64_t seed) {
  const auto stream = [&](const std::string& purpose) {
    return Rng(StreamSeed(seed, "town", purpose));
  };
  Atlas atlas(kThings, 14, 7.6, 80);
  const Materials materials = PaintMaterials(atlas);
  const TownMaterials town_materials = PaintTownMaterials(atlas);
  TownScene scene;
  scene.map.texture_names = {"ground", "things"};
  scene.map.textures = {PaintTownGround(town, kGroundPxPerM, stream("ground")).ToImage(), {}};
  AddGround(town, scene.map.mesh);

  std::vector<BuiltHouse> houses(town.houses().size());
  ParallelFor(houses.size(), 0, [&](size_t i) {
    const auto number = static_cast<int>(i) + 1;
    houses[i] = BuildHouse(town.houses()[i], materials, number, kFirstHouse + static_cast<int>(i),
                           stream("house " + std::to_string(number)));
  });
  for (size_t i = 0; i < houses.size(); ++i) {
    scene.map.texture_names.push_back("house_" + std::to_string(i + 1));
    scene.map.textures.push_back(std::move(houses[i].sheet));
    scene.map.mesh.Append(houses[i].mesh);
  }
  Rng things = stream("things");
  PropContext context{scene.objects, materials, things};
  AddObjects(town, town_materials, context);
  AddFields(town, town_materials.field, scene.fields, things);
  scene.map.textures[kThings] = atlas.canvas().ToImage();
  return scene;
}

std::vector<PosedImage> PhoneViews(const Town& town, const RayCaster& caster, Rng rng, int count) {
  const Camera wide(CameraModel::kSimpleRadial, 640, 480, std::array{490.0, 321.5, 238.7, -0.02});
  const Camera upright(CameraModel::kSimpleRadial, 480, 640, std::array{500.0, 238.2, 322.7, 0.01});
  std::vector<PosedImage> views;
  while (views.size() < static_cast<size_t>(count)) {
    const auto street = static_cast<int>(rng.UniformIndex(Town::kStreets));
    const Town::Place place = town.OnStreet(street, rng.Uniform(8, Town::StreetLength(street) - 8));
    const double aside = rng.Uniform() < 0.5 ? -1 : 1;
    const Vector2d at =
        place.at + aside * rng.Uniform(2.8, 4.4) * Vector2d(place.along.y(), -place.along.x());
    // Across the street, more or less along it.
    const double along = std::atan2(place.along.y(), place.along.x()) * 180 / std::numbers::pi;
    const double turn = rng.Uniform(30, 110) * aside;
    const double flip = rng.Uniform() < 0.5 ? 0 : 180;
    const Vector3d center = town.OnGround(at.x(), at.y()) + Vector3d(0, 0, rng.Uniform(1.45, 1.75));
    PosedImage view{Numbered("phone/phone_", views.size() + 1),
                    rng.Uniform() < 0.7 ? wide : upright,
                    CamFromWorld(center, along + flip + (flip > 0 ? -turn : turn),
                                 rng.Uniform(3, 12), rng.Uniform(-3, 3))};
    const Sight sight = SightOf(caster, view);
    if (sight.share > 0.6 && sight.nearest > 1.8) views.push_back(std::move(view));
  }
  return views;
}

std::vector<PosedImage> DroneViews(const Town& town, const RayCaster& caster, Rng rng, int count) {
  const Camera lens(CameraModel::kOpenCv, 640, 480,
                    std::array{470.0, 470.0, 318.4, 241.9, -0.02, 0.01, 0.0004, -0.0003});
  std::vector<PosedImage> views;
  while (views.size() < static_cast<size_t>(count)) {
    const bool is_nadir = views.size() % 2 == 0;
    const Vector2d at(rng.Uniform(25, Town::kWidth - 25), rng.Uniform(25, Town::kDepth - 25));
    const Vector3d center = town.OnGround(at.x(), at.y()) +
                            Vector3d(0, 0, is_nadir ? rng.Uniform(35, 50) : rng.Uniform(22, 38));
    PosedImage view{Numbered("drone/drone_", views.size() + 1), lens,
                    CamFromWorld(center, rng.Uniform(0, 360),
                                 is_nadir ? rng.Uniform(-89, -84) : rng.Uniform(-50, -28),
                                 rng.Uniform(-1.5, 1.5))};
    if (SightOf(caster, view).share > (is_nadir ? 0.95 : 0.85)) views.push_back(std::move(view));
  }
  return views;
}

}  // namespace raylift::demo
