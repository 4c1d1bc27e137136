#include "raylift/renderers/view_renderer.h"

#include <algorithm>
#include <cmath>

#include "texture.h"
#include <Eigen/Geometry>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr int kTileSide = 8;
constexpr int kTilePixels = kTileSide * kTileSide;

// The rays of one sample in each pixel of a tile, 4 x 4 pixels in a row of 16.
struct TileView {
  std::array<std::optional<Eigen::Vector3d>, kTilePixels> rays_in_cam;
  std::array<Eigen::Vector3d, kTilePixels> directions_in_world;  // zero where there is no ray
  std::array<std::optional<RayHit>, kTilePixels> hits;

  static int X(int i) { return (i / 16) % 2 * 4 + i % 4; }
  static int Y(int i) { return (i / 32) * 4 + i % 16 / 4; }
  static int Index(int x, int y) { return (y / 4 * 2 + x / 4) * 16 + y % 4 * 4 + x % 4; }

  // The solid angle of a pixel, from its neighbours' rays in the tile; none where they lack.
  std::optional<double> SolidAngle(int i) const {
    const auto& here = RayAt(X(i), Y(i));
    const auto& beside = RayAt(X(i) ^ 1, Y(i));
    const auto& below = RayAt(X(i), Y(i) ^ 1);
    if (!here || !beside || !below) {
      return std::nullopt;
    }
    return (*beside - *here).cross(*below - *here).norm();
  }

 private:
  const std::optional<Eigen::Vector3d>& RayAt(int x, int y) const {
    return rays_in_cam[static_cast<size_t>(Index(x, y))];
  }
};

class View {
 public:
  View(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world)
      : caster_(caster),
        camera_(camera),
        center_in_world_(cam_from_world.OriginInSource()),
        world_from_cam_(cam_from_world.rotation.conjugate().toRotationMatrix()) {}

  // `offset` is the sample's place in its pixel; (0.5, 0.5) is the centre.
  void Cast(int tile_x, int tile_y, const Eigen::Vector2d& offset, TileView& tile) const {
    for (int i = 0; i < kTilePixels; ++i) {
      const int x = tile_x + TileView::X(i);
      const int y = tile_y + TileView::Y(i);
      const bool in_image = x < camera_.width_px() && y < camera_.height_px();
      const auto at = static_cast<size_t>(i);
      tile.rays_in_cam[at] =
          in_image ? camera_.RayInCam(Eigen::Vector2d(x, y) + offset) : std::nullopt;
      tile.directions_in_world[at].setZero();
      if (tile.rays_in_cam[at]) {
        tile.directions_in_world[at] = world_from_cam_ * *tile.rays_in_cam[at];
      }
    }
    caster_.CastCoherent(center_in_world_, tile.directions_in_world, tile.hits);
  }

  // Calls body(tile_y) for every row of tiles, in parallel.
  template <typename Body>
  void ForEachTileRow(int threads, const Body& body) const {
    const int rows = (camera_.height_px() + kTileSide - 1) / kTileSide;
    ParallelFor(static_cast<size_t>(rows), threads,
                [&](size_t row) { body(static_cast<int>(row) * kTileSide); });
  }

  const Camera& camera() const { return camera_; }
  const Eigen::Vector3d& center_in_world() const { return center_in_world_; }

 private:
  const RayCaster& caster_;
  const Camera& camera_;
  Eigen::Vector3d center_in_world_;
  Eigen::Matrix3d world_from_cam_;
};

// The colour of a hit.
class Shader {
 public:
  Shader(const RayCaster& caster, const Camera& camera, const ColorOptions& options)
      : caster_(caster),
        mesh_(caster.mesh()),
        options_(options),
        to_sun_(-options.sun_direction_in_world.normalized()),
        central_solid_angle_(1 / (camera.focal_x_px() * camera.focal_y_px())) {
    for (const Image& image : mesh_.textures) {
      textures_.emplace_back(image);
    }
  }

  Eigen::Vector3f Color(const TileView& tile, int i, const Eigen::Vector3d& center_in_world) const {
    const RayHit& hit = *tile.hits[static_cast<size_t>(i)];
    const Eigen::Vector3d& direction_in_world = tile.directions_in_world[static_cast<size_t>(i)];
    const double cosine = std::abs(hit.normal_in_world.dot(direction_in_world));
    const double sample_solid_angle =
        tile.SolidAngle(i).value_or(central_solid_angle_) /
        (options_.samples_per_pixel_side * options_.samples_per_pixel_side);
    const double footprint = hit.ray_t * hit.ray_t * sample_solid_angle / std::max(cosine, 0.05);
    const Eigen::Vector3f own = OwnColor(hit, footprint);
    switch (options_.shading) {
      case ColorOptions::Shading::kUnlit:
        return own;
      case ColorOptions::Shading::kHeadlight:
        return own * static_cast<float>(cosine);
      case ColorOptions::Shading::kSun:
        return own * static_cast<float>(SunLight(hit, center_in_world, direction_in_world));
    }
    return own;
  }

 private:
  // `footprint` is the area of the surface that the sample covers.
  Eigen::Vector3f OwnColor(const RayHit& hit, double footprint) const {
    const auto& [i0, i1, i2] = mesh_.triangles[hit.triangle];
    const auto u = static_cast<float>(hit.barycentric.x());
    const auto v = static_cast<float>(hit.barycentric.y());
    const float w = 1 - u - v;
    const int32_t texture =
        mesh_.triangle_textures.empty() ? -1 : mesh_.triangle_textures[hit.triangle];
    if (texture >= 0) {
      const auto& uvs = mesh_.texture_coordinates;
      const Eigen::Vector2f uv = w * uvs[i0] + u * uvs[i1] + v * uvs[i2];
      const Texture& sampled = textures_[static_cast<size_t>(texture)];
      return sampled.Sample(uv, TextureLevel(hit, sampled, footprint));
    }
    if (!mesh_.vertex_colors_rgb.empty()) {
      return w * VertexColor(i0) + u * VertexColor(i1) + v * VertexColor(i2);
    }
    return ToVector(options_.untextured_rgb);
  }

  Eigen::Vector3f VertexColor(uint32_t index) const {
    return ToVector(mesh_.vertex_colors_rgb[index]);
  }

  static Eigen::Vector3f ToVector(const std::array<uint8_t, 3>& rgb) {
    return {static_cast<float>(rgb[0]), static_cast<float>(rgb[1]), static_cast<float>(rgb[2])};
  }

  // Half the base-2 logarithm of the texels that the footprint covers.
  double TextureLevel(const RayHit& hit, const Texture& texture, double footprint) const {
    const auto& [i0, i1, i2] = mesh_.triangles[hit.triangle];
    const auto& uvs = mesh_.texture_coordinates;
    const Eigen::Vector2f a = uvs[i1] - uvs[i0];
    const Eigen::Vector2f b = uvs[i2] - uvs[i0];
    const double texels =
        std::abs(static_cast<double>(a.x() * b.y() - a.y() * b.x())) * texture.NumTexels();
    const Eigen::Vector3f edge1 = mesh_.vertices[i1] - mesh_.vertices[i0];
    const Eigen::Vector3f edge2 = mesh_.vertices[i2] - mesh_.vertices[i0];
    const double area = edge1.cross(edge2).cast<double>().norm();
    const double covered = footprint * texels / area;
    return covered > 1 ? 0.5 * std::log2(covered) : 0.0;
  }

  // Ambient light, and the sun's where the side that the viewer sees is turned to it and nothing
  // stands between.
  double SunLight(const RayHit& hit, const Eigen::Vector3d& center_in_world,
                  const Eigen::Vector3d& direction_in_world) const {
    const bool is_front = hit.normal_in_world.dot(direction_in_world) < 0;
    const Eigen::Vector3d normal = is_front ? hit.normal_in_world : -hit.normal_in_world;
    const double cosine = normal.dot(to_sun_);
    if (cosine <= 0) {
      return options_.ambient;
    }
    const Eigen::Vector3d point = center_in_world + hit.ray_t * direction_in_world;
    // Off the surface by more than float resolves at this place.
    const double lift = 1e-5 * ((point - mesh_.origin_in_world).norm() + hit.ray_t);
    if (caster_.IsOccluded({point + lift * normal, to_sun_})) {
      return options_.ambient;
    }
    return options_.ambient + (1 - options_.ambient) * cosine;
  }

  const RayCaster& caster_;
  const TriangleMesh& mesh_;
  const ColorOptions& options_;
  Eigen::Vector3d to_sun_;
  double central_solid_angle_;  // of a pixel
  std::vector<Texture> textures_;
};

// Adds up the samples of the tile's pixels.
void RenderTile(const View& view, const Shader& shader, const ColorOptions& options, int tile_x,
                int tile_y, std::array<Eigen::Vector3f, kTilePixels>& sums) {
  const Eigen::Vector3f background(static_cast<float>(options.background_rgb[0]),
                                   static_cast<float>(options.background_rgb[1]),
                                   static_cast<float>(options.background_rgb[2]));
  const int side = options.samples_per_pixel_side;
  sums.fill(Eigen::Vector3f::Zero());
  TileView tile;
  for (int sample = 0; sample < side * side; ++sample) {
    const Eigen::Vector2d offset((sample % side + 0.5) / side, (sample / side + 0.5) / side);
    view.Cast(tile_x, tile_y, offset, tile);
    for (int i = 0; i < kTilePixels; ++i) {
      const auto at = static_cast<size_t>(i);
      sums[at] += tile.hits[at] ? shader.Color(tile, i, view.center_in_world()) : background;
    }
  }
}

}  // namespace

DepthMap RenderDepth(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                     int threads) {
  const View view(caster, camera, cam_from_world);
  DepthMap map{camera.width_px(), camera.height_px(), {}};
  map.z.resize(static_cast<size_t>(map.width_px) * static_cast<size_t>(map.height_px));
  view.ForEachTileRow(threads, [&](int tile_y) {
    TileView tile;
    for (int tile_x = 0; tile_x < map.width_px; tile_x += kTileSide) {
      view.Cast(tile_x, tile_y, {0.5, 0.5}, tile);
      for (int i = 0; i < kTilePixels; ++i) {
        const auto at = static_cast<size_t>(i);
        if (!tile.hits[at]) continue;
        const double z = tile.hits[at]->ray_t * tile.rays_in_cam[at]->z();
        const auto row = static_cast<size_t>(tile_y + TileView::Y(i));
        map.z[row * static_cast<size_t>(map.width_px) +
              static_cast<size_t>(tile_x + TileView::X(i))] = static_cast<float>(std::max(z, 0.0));
      }
    }
  });
  return map;
}

Image RenderColor(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                  const ColorOptions& options, int threads) {
  RAYLIFT_CHECK(options.samples_per_pixel_side >= 1);
  const View view(caster, camera, cam_from_world);
  const Shader shader(caster, camera, options);
  Image image{camera.width_px(), camera.height_px(), 3, {}};
  image.data.resize(static_cast<size_t>(image.width_px) * static_cast<size_t>(image.height_px) * 3);
  const auto num_samples =
      static_cast<float>(options.samples_per_pixel_side * options.samples_per_pixel_side);
  view.ForEachTileRow(threads, [&](int tile_y) {
    std::array<Eigen::Vector3f, kTilePixels> sums;
    for (int tile_x = 0; tile_x < image.width_px; tile_x += kTileSide) {
      RenderTile(view, shader, options, tile_x, tile_y, sums);
      for (int i = 0; i < kTilePixels; ++i) {
        const int x = tile_x + TileView::X(i);
        const int y = tile_y + TileView::Y(i);
        if (x >= image.width_px || y >= image.height_px) continue;
        const Eigen::Vector3f mean = sums[static_cast<size_t>(i)] / num_samples;
        for (int c = 0; c < 3; ++c) {
          image.Pixel(x, y)[c] = static_cast<uint8_t>(std::clamp(mean[c], 0.0f, 255.0f) + 0.5f);
        }
      }
    }
  });
  return image;
}

}  // namespace raylift
