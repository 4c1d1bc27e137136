#include "support/room_scene.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <vector>

#include "base/rng.h"
#include "support/match_file.h"
#include "support/meshes.h"
#include <fmt/format.h>

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/hloc_files.h"
#include "raylift/io/image_file.h"
#include "raylift/io/query_list.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/photographs.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

constexpr int kTilePx = 256;  // of the texture, per surface
constexpr int kTilesPerRow = 4;
constexpr int kTileRows = 3;

// Smooth noise of several sizes, which has blobs for SIFT at every scale.
Image NoiseTexture() {
  Image image{kTilePx * kTilesPerRow, kTilePx * kTileRows, 3, {}};
  image.data.resize(static_cast<size_t>(image.width_px) * image.height_px * 3);
  std::vector<double> sum(image.data.size(), 0.0);
  Rng rng(StreamSeed(7, "room", "noise"));
  for (const int cell_px : {3, 6, 12, 24}) {
    const int columns = image.width_px / cell_px + 2;
    const int rows = image.height_px / cell_px + 2;
    std::vector<double> grid(static_cast<size_t>(columns) * rows * 3);
    for (double& value : grid) value = rng.Normal();
    for (int y = 0; y < image.height_px; ++y) {
      for (int x = 0; x < image.width_px; ++x) {
        const int column = x / cell_px;
        const int row = y / cell_px;
        const double u = static_cast<double>(x % cell_px) / cell_px;
        const double v = static_cast<double>(y % cell_px) / cell_px;
        for (int c = 0; c < 3; ++c) {
          const auto at = [&](int i, int j) {
            return grid[(static_cast<size_t>(j) * columns + i) * 3 + c];
          };
          sum[(static_cast<size_t>(y) * image.width_px + x) * 3 + c] +=
              (1 - v) * ((1 - u) * at(column, row) + u * at(column + 1, row)) +
              v * ((1 - u) * at(column, row + 1) + u * at(column + 1, row + 1));
        }
      }
    }
  }
  for (size_t i = 0; i < sum.size(); ++i) {
    image.data[i] = static_cast<uint8_t>(std::clamp(std::lround(128 + 45 * sum[i]), 0L, 255L));
  }
  return image;
}

struct Quad {
  Vector3d corner, u, v;
};

// The six sides of a box, u x v inward.
std::vector<Quad> SidesFromInside(const Vector3d& low, const Vector3d& high) {
  const Vector3d size = high - low;
  const Vector3d x(size.x(), 0, 0), y(0, size.y(), 0), z(0, 0, size.z());
  return {{low, x, y}, {low, y, z}, {low, z, x}, {high, -y, -x}, {high, -z, -y}, {high, -x, -z}};
}

std::vector<Quad> RoomQuads() {
  std::vector<Quad> quads = SidesFromInside({-3, -1.5, -2}, {3, 1.5, 2});
  for (Quad quad : SidesFromInside({-0.4, 0.5, 0.4}, {0.8, 1.5, 1.3})) {
    std::swap(quad.u, quad.v);  // seen from outside
    quads.push_back(quad);
  }
  return quads;
}

void WriteRoomMesh(const RoomScene& scene, const Vector3d& offset) {
  WriteImage(scene.folder / "noise.png", NoiseTexture());
  WriteFile(scene.folder / "room.mtl", "newmtl noise\nKd 1 1 1\nmap_Kd noise.png\n");
  std::string text = "mtllib room.mtl\nusemtl noise\n";
  int tile = 0;
  for (const Quad& quad : RoomQuads()) {
    const int column = tile % kTilesPerRow;
    const int row = tile / kTilesPerRow;
    for (const auto& [a, b] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}}) {
      const Vector3d p = offset + quad.corner + a * quad.u + b * quad.v;
      text += fmt::format("v {:.6f} {:.6f} {:.6f}\nvt {:.6f} {:.6f}\n", p.x(), p.y(), p.z(),
                          (column + 0.02 + 0.96 * a) / kTilesPerRow,
                          (row + 0.02 + 0.96 * b) / kTileRows);
    }
    const int i = 4 * tile + 1;
    text += fmt::format("f {0}/{0} {1}/{1} {2}/{2} {3}/{3}\n", i, i + 1, i + 2, i + 3);
    ++tile;
  }
  WriteFile(scene.mesh(), text);
}

PosedImage MakeView(const std::string& name, const Vector3d& center, const Vector3d& target,
                    const Vector3d& offset) {
  const Camera camera(CameraModel::kSimpleRadial, 320, 240,
                      std::vector<double>{260, 161.2, 119.3, -0.03});
  return {name, camera, LookAt(center + offset, target + offset)};
}

void WriteModel(const std::filesystem::path& folder, const std::vector<PosedImage>& views,
                ColmapForm form) {
  ColmapModel model;
  uint32_t id = 0;
  for (const PosedImage& view : views) {
    model.cameras.emplace(++id, view.camera);
    ColmapImage image;
    image.name = view.name;
    image.camera_id = id;
    image.SetCamFromWorld(view.cam_from_world);
    model.images.emplace(id, image);
  }
  WriteColmapModel(folder, model, form);
}

// Pixels of the points that a view sees, by point.
class Visibility {
 public:
  Visibility(const RayCaster& caster, const std::vector<Vector3d>& points)
      : caster_(caster), points_(points) {}

  std::map<int, Eigen::Vector2d> SeenBy(const PosedImage& view) const {
    std::map<int, Eigen::Vector2d> pixels;
    const Vector3d center = view.cam_from_world.OriginInSource();
    for (size_t i = 0; i < points_.size(); ++i) {
      const auto pixel = view.camera.ImgFromCam(view.cam_from_world * points_[i]);
      if (!pixel || !view.camera.Contains(*pixel)) continue;
      const std::vector<Ray> ray = {{center, points_[i] - center}};
      const auto hit = caster_.Cast(ray)[0];
      if (hit && std::abs(hit->ray_t - 1) < 1e-5) {
        pixels.emplace(static_cast<int>(i), *pixel);
      }
    }
    return pixels;
  }

 private:
  const RayCaster& caster_;
  const std::vector<Vector3d>& points_;
};

// What random pixels of all views show, away from the surfaces' edges.
std::vector<Vector3d> SurfacePoints(const RayCaster& caster, const std::vector<PosedImage>& views) {
  std::vector<Vector3d> points;
  Rng rng(StreamSeed(7, "room", "points"));
  for (const PosedImage& view : views) {
    const Rigid3 world_from_cam = view.cam_from_world.Inverse();
    for (int i = 0; i < 60; ++i) {
      const Eigen::Vector2d pixel(rng.Uniform(2, 318), rng.Uniform(2, 238));
      const std::vector<Ray> ray = {
          {world_from_cam.translation, world_from_cam.rotation * *view.camera.RayInCam(pixel)}};
      const auto hit = caster.Cast(ray)[0];
      const double margin = 0.03;
      if (!hit || hit->barycentric.minCoeff() < margin || hit->barycentric.sum() > 1 - margin) {
        continue;
      }
      points.push_back(ray[0].origin_in_world + hit->ray_t * ray[0].direction_in_world);
    }
  }
  return points;
}

void WriteMatches(const RoomScene& scene, const RayCaster& caster) {
  std::vector<PosedImage> views = scene.references;
  views.insert(views.end(), scene.queries.begin(), scene.queries.end());
  const std::vector<Vector3d> points = SurfacePoints(caster, views);
  const Visibility visibility(caster, points);
  std::map<std::string, std::map<int, Eigen::Vector2d>> seen;
  std::map<std::string, Features> features;
  for (const PosedImage& view : views) {
    seen[view.name] = visibility.SeenBy(view);
    Features& f = features[view.name];
    f.image_width_px = view.camera.width_px();
    f.image_height_px = view.camera.height_px();
    for (const auto& [point, pixel] : seen[view.name]) f.keypoints_px.push_back(pixel);
  }
  std::vector<MatchedPair> all_matches;
  std::vector<std::pair<std::string, std::string>> pairs;
  for (const PosedImage& query : scene.queries) {
    for (const PosedImage& reference : scene.references) {
      const auto& in_query = seen[query.name];
      const auto& in_reference = seen[reference.name];
      MatchedPair& pair =
          all_matches.emplace_back(MatchedPair{query.name, reference.name, in_query.size(), {}});
      int query_index = 0;
      for (const auto& [point, pixel] : in_query) {
        const auto other = in_reference.find(point);
        if (other != in_reference.end()) {
          const auto index = static_cast<int>(std::distance(in_reference.begin(), other));
          pair.matches.push_back({query_index, index, 1});
        }
        ++query_index;
      }
      pairs.emplace_back(query.name, reference.name);
    }
  }
  WriteFeatureFile(scene.features(), features, false);
  WriteMatchFile(scene.matches(), all_matches);
  WritePairs(scene.pairs(), pairs);
}

// Returns the pictures of the views. They are rendered once in each process: under the sanitizers that
// takes longer than most tests that need them.
const std::vector<Image>& Pictures(const RayCaster& caster, const std::vector<PosedImage>& views) {
  static const std::vector<Image> pictures = [&] {
    ColorOptions colors;
    colors.samples_per_pixel_side = 2;
    std::vector<Image> rendered;
    for (const PosedImage& view : views) {
      rendered.push_back(RenderColor(caster, view.camera, view.cam_from_world, colors, 1));
    }
    return rendered;
  }();
  return pictures;
}

}  // namespace

RoomScene WriteRoomScene(const std::filesystem::path& folder, const RoomOptions& options) {
  RoomScene scene{folder, {}, {}};
  for (int i = 0; i < 6; ++i) {
    const double x = -1.25 + 0.5 * i;
    scene.references.push_back(MakeView(fmt::format("ref/{:02}.png", i),
                                        {x, -0.2 + 0.15 * (i % 3), -1.5 + 0.2 * (i % 2)},
                                        {0.4 * x, 0.1, 2}, options.offset));
  }
  scene.queries.push_back(
      MakeView("query/a.png", {-0.45, 0.05, -1.3}, {-0.3, 0.2, 2}, options.offset));
  scene.queries.push_back(
      MakeView("query/b.png", {0.6, -0.1, -1.45}, {0.15, 0.0, 2}, options.offset));

  WriteRoomMesh(scene, options.offset);
  WriteModel(scene.model(), scene.references, ColmapForm::kText);
  WriteModel(scene.truth(), scene.queries, ColmapForm::kBinary);
  std::vector<Query> queries;
  for (const PosedImage& query : scene.queries) queries.push_back({query.name, query.camera});
  WriteQueryList(scene.query_list(), queries);

  const RayCaster caster(std::make_shared<const TriangleMesh>(ReadMesh(scene.mesh())));
  if (options.matches) WriteMatches(scene, caster);
  if (options.pictures) {
    if (!options.offset.isZero()) throw std::invalid_argument("only the room at 0 has pictures");
    std::vector<PosedImage> views = scene.references;
    views.insert(views.end(), scene.queries.begin(), scene.queries.end());
    const std::vector<Image>& pictures = Pictures(caster, views);
    for (size_t i = 0; i < views.size(); ++i) {
      WriteImage(scene.images() / views[i].name, pictures[i]);
    }
  }
  return scene;
}

}  // namespace raylift
