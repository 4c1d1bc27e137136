#include "town_files.h"

#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <utility>

#include "base/constants.h"
#include "city_files.h"
#include "geotiff.h"
#include "photograph.h"
#include "scene_writer.h"
#include "town.h"
#include <Eigen/Geometry>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift::demo {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using std::filesystem::path;

constexpr int kReferences = 24;
constexpr int kSamplesPerSide = 2;  // the town is large, and its pictures are many
constexpr double kDsmCell = 0.25, kOrthoCell = 0.1;

constexpr const char* kReadme =
    R"(A made town (raylift_make_demo --town), in EPSG:25832: meters, easting, northing, height.

scene.obj, *.jpg             the map: ground and houses with textures
bare.ply                     the same without colors: overhanging roofs, dormers, window frames
lod2.city.json, lod2.gml     the houses as blocks (LoD1) and with plain roofs (LoD2), the ground
dsm.tif, ortho.tif           the surface from above: heights every 0.25 m, colors every 0.1 m
images/drone, images/phone   queries, on a hazy afternoon; trees, cars, crates and parasols stand
                             there, which the map lacks. queries.txt, queries_drone.txt and
                             queries_phone.txt list them, priors.txt says where GNSS (3 m) and
                             compass (10 degrees) or gimbal (2 degrees) have them
ground_truth                 their poses, exact, as a COLMAP text model
images/ref, model            references by drone, on a clear morning without what the map lacks
frame.json                   the coordinate system, and the point near all coordinates
)";

// A ray straight down through each pixel.
PixelGrid FromAbove(double cell_m) {
  return {static_cast<int>(std::lround(Town::kWidth / cell_m)),
          static_cast<int>(std::lround(Town::kDepth / cell_m)), [cell_m](const Vector2d& pixel) {
            constexpr double kAbove = 200;
            return Ray{{cell_m * pixel.x(), Town::kDepth - cell_m * pixel.y(), kAbove},
                       -Vector3d::UnitZ()};
          }};
}

RasterPlace PlaceOf(double cell_m) {
  const auto code = static_cast<uint16_t>(std::stoi(std::string(kTownCrs).substr(5)));
  return {code, kTownOrigin.head<2>() + Vector2d(0, Town::kDepth), cell_m};
}

void WriteSurfaceModel(const path& folder, const RayCaster& map, uint64_t seed) {
  const PixelGrid grid = FromAbove(kDsmCell);
  std::vector<float> heights;
  for (int row = 0; row < grid.height_px; ++row) {
    std::vector<Ray> rays;
    for (int column = 0; column < grid.width_px; ++column) {
      rays.push_back(grid.ray({column + 0.5, row + 0.5}));
    }
    const auto hits = map.Cast(rays);
    for (size_t i = 0; i < rays.size(); ++i) {
      heights.push_back(hits[i] ? static_cast<float>(rays[i].origin_in_world.z() - hits[i]->ray_t)
                                : std::numeric_limits<float>::quiet_NaN());
    }
  }
  WriteHeights(folder / "dsm.tif", PlaceOf(kDsmCell), grid.width_px, heights);
  const Sensor sensor{.blur_px = 0.4,
                      .vignetting = 0,
                      .shot_noise = 1,
                      .read_noise = 0.5,
                      .samples_per_side = kSamplesPerSide};
  WriteOrthophoto(folder / "ortho.tif", PlaceOf(kOrthoCell),
                  TakePhotograph(map, FromAbove(kOrthoCell), kMorning, sensor, seed, 0));
}

std::vector<PosedImage> InCrs(std::vector<PosedImage> views) {
  for (PosedImage& view : views) {
    view.cam_from_world.translation -= view.cam_from_world.rotation * kTownOrigin;
  }
  return views;
}

// What GNSS, a compass and a gimbal say, as raylift's priors; phones know what is down.
std::string PriorsOf(const std::vector<PosedImage>& queries, Rng& rng) {
  std::string text = fmt::format("* world_crs {}\n", kTownCrs);
  const auto draw = [&rng](double sigma) -> Vector3d {
    return sigma * Vector3d{rng.Normal(), rng.Normal(), rng.Normal()};
  };
  for (const PosedImage& query : queries) {
    const Rigid3& pose = query.cam_from_world;
    const Vector3d at = pose.OriginInSource() + draw(3);
    text += fmt::format("{} position {:.3f} {:.3f} {:.3f} 3\n", query.name, at.x(), at.y(), at.z());
    if (query.name.starts_with("drone")) {
      const Eigen::Quaterniond q =
          (RotationFromVector(draw(2 * kRadPerDeg)) * pose.rotation).normalized();
      text += fmt::format("{} orientation {:.6f} {:.6f} {:.6f} {:.6f} 2\n", query.name, q.w(),
                          q.x(), q.y(), q.z());
      continue;
    }
    const Vector3d forward = pose.rotation.conjugate() * Vector3d::UnitZ();
    const double heading = std::atan2(forward.x(), forward.y()) / kRadPerDeg + 10 * rng.Normal();
    const Vector3d down =
        RotationFromVector(draw(kRadPerDeg)) * (pose.rotation * -Vector3d::UnitZ());
    text += fmt::format("{} heading {:.2f} 10\n", query.name, std::fmod(heading + 720, 360));
    text += fmt::format("{} gravity {:.5f} {:.5f} {:.5f} 1\n", query.name, down.x(), down.y(),
                        down.z());
  }
  return text;
}

void WriteMaps(const path& folder, const Town& town, const TownScene& scene) {
  WriteScene(folder, scene.map, "A town, in metres, z up, EPSG:25832", kTownOrigin);
  TriangleMesh bare = scene.map.mesh.ToTriangleMesh({});
  bare.origin_in_world = kTownOrigin;
  WritePly(folder / "bare.ply", bare);
  WriteFile(folder / "lod2.city.json", CityJsonOf(town));
  WriteFile(folder / "lod2.gml", CityGmlOf(town));
  const nlohmann::json frame{{"crs", kTownCrs},
                             {"origin", {kTownOrigin.x(), kTownOrigin.y(), kTownOrigin.z()}}};
  WriteFile(folder / "frame.json", frame.dump() + "\n");
  WriteFile(folder / "README.txt", kReadme);
}

}  // namespace

void MakeTown(const path& folder, uint64_t seed, int photographs) {
  const Town town(seed);
  const TownScene scene = BuildTown(town, seed);
  WriteMaps(folder, town, scene);
  const auto caster_of = [&](const MeshBuilder& mesh) {
    return RayCaster(std::make_shared<const TriangleMesh>(mesh.ToTriangleMesh(scene.map.textures)));
  };
  const RayCaster map = caster_of(scene.map.mesh);
  WriteSurfaceModel(folder, map, seed);

  MeshBuilder around = scene.map.mesh;
  around.Append(scene.fields);
  const auto stream = [&](const char* purpose) { return Rng(StreamSeed(seed, "town", purpose)); };
  std::vector<PosedImage> references = DroneViews(town, map, stream("references"), kReferences);
  for (PosedImage& view : references) view.name.replace(0, 11, "ref/ref");
  WriteViews(folder / "model", InCrs(references));
  TakeReferences(folder / "images", caster_of(around), references, seed, kSamplesPerSide);

  around.Append(scene.objects);
  const RayCaster changed = caster_of(around);
  const auto drones = DroneViews(town, map, stream("drones"), photographs);
  const auto phones = PhoneViews(town, changed, stream("phones"), photographs);
  std::vector<PosedImage> all = drones;
  all.insert(all.end(), phones.begin(), phones.end());
  WriteQueries(folder / "queries.txt", all);
  WriteQueries(folder / "queries_drone.txt", drones);
  WriteQueries(folder / "queries_phone.txt", phones);
  WriteViews(folder / "ground_truth", InCrs(all));
  Rng errors = stream("errors");
  WriteFile(folder / "priors.txt", PriorsOf(InCrs(all), errors));
  TakeQueries(folder / "images", changed, all, seed, kSamplesPerSide);
}

}  // namespace raylift::demo
