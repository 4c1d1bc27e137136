// A frame is rendered in tiles of 8 x 8 pixels: each is four blocks of 4 x 4, whose 16 rays Embree
// traces as one packet. Some tiles of a row are turned into the world, cast and stored at a time,
// so that their packets stay in the first cache; rows of tiles run on different threads.
//
// Depth and distance come from the packets themselves, in float. What needs the triangle (normals,
// incidence, color) is refined hit by hit in double, and so is the depth of grazing rays, which
// the rounding of their direction would move. Supersampled color is cast anew: its rays are those
// of the pixels' centers, moved by how the ray changes from pixel to pixel.

#include "raylift/renderers/frame_renderer.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <span>
#include <vector>

#include "renderers/block_kernels.h"
#include "renderers/splat_blend.h"
#include "renderers/surface_shader.h"
#include <Eigen/Geometry>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/scene/image.h"

namespace raylift {
namespace {

constexpr int kSide = static_cast<int>(RayBlock::kSide);
constexpr int kTileBlocks = 2;  // per side: tiles of 8 x 8 pixels
constexpr int kTileSide = kTileBlocks * kSide;
constexpr size_t kBlocksPerTile = size_t{kTileBlocks} * kTileBlocks;
// Tiles in a row that are cast at a time; what they need stays in the first cache.
constexpr size_t kTilesAtATime = 8;
constexpr double kDegPerRad = 180 / std::numbers::pi;

Eigen::Vector3f Lane(const RayBlock& rays, size_t i) { return {rays.x[i], rays.y[i], rays.z[i]}; }

}  // namespace

struct FrameRenderer::Impl {
  Impl(std::shared_ptr<const RayCaster> caster_in, const FrameOptions& options_in)
      : caster(std::move(caster_in)), options(options_in) {
    if (options.color) {
      shader.emplace(*caster, options.color_options);
    }
  }

  bool NeedsRefinedHits() const {
    return options.normals || options.incidence ||
           (options.color && options.color_options.samples_per_pixel_side == 1);
  }

  std::shared_ptr<const RayCaster> caster;
  FrameOptions options;
  std::optional<SurfaceShader> shader;
};

namespace {

// One view being rendered: fills the maps of its frame.
class ViewPass {
 public:
  ViewPass(const RayCaster& caster, const FrameOptions& options, const SurfaceShader* shader,
           bool refine, std::span<const Eigen::Vector3f> splat_colors, const PixelRays& rays,
           const Rigid3& cam_from_world, Frame& frame)
      : caster_(caster),
        options_(options),
        shader_(shader),
        refine_(refine),
        splat_colors_(splat_colors),
        rays_(rays),
        center_in_world_(cam_from_world.OriginInSource()),
        world_from_cam_(cam_from_world.rotation.conjugate().toRotationMatrix()),
        world_from_cam_float_(world_from_cam_.cast<float>()),
        frame_(frame) {}

  // Returns the number of pixels that see the mesh.
  size_t RenderTileRow(int tile_y) const {
    constexpr int kWidth = static_cast<int>(kTilesAtATime) * kTileSide;
    size_t num_hits = 0;
    Batch batch;
    for (int x = 0; x < rays_.width_px(); x += kWidth) {
      batch.count = 0;
      for (int tile_x = x; tile_x < std::min(x + kWidth, rays_.width_px()); tile_x += kTileSide) {
        AddTile(tile_x, tile_y, batch);
      }
      num_hits += RenderBatch(batch);
    }
    return num_hits;
  }

 private:
  struct Batch {
    static constexpr size_t kCapacity = kTilesAtATime * kBlocksPerTile;
    size_t count = 0;
    std::array<int, kCapacity> xs;  // of the first pixel
    std::array<int, kCapacity> ys;
    std::array<RayBlock, kCapacity> rays_in_world;
    std::array<HitBlock, kCapacity> hits;
  };

  void AddTile(int tile_x, int tile_y, Batch& batch) const {
    for (int i = 0; i < static_cast<int>(kBlocksPerTile); ++i) {
      const int x = tile_x + i % kTileBlocks * kSide;
      const int y = tile_y + i / kTileBlocks * kSide;
      if (x >= rays_.width_px() || y >= rays_.height_px()) continue;
      TurnBlock(x / kSide, y / kSide, batch.rays_in_world[batch.count]);
      batch.xs[batch.count] = x;
      batch.ys[batch.count] = y;
      ++batch.count;
    }
  }

  void TurnBlock(int bx, int by, RayBlock& in_world) const {
    if (rays_.is_pinhole()) {
      RotateSlopes(world_from_cam_float_, rays_.ColumnSlopes(bx), rays_.RowSlopes(by), in_world);
      return;
    }
    RotateBlock(world_from_cam_float_, rays_.Block(bx, by), in_world);
    constexpr int kAhead = static_cast<int>(kTilesAtATime) * kTileBlocks;
    if ((bx + kAhead) * kSide < rays_.width_px()) Prefetch(rays_.Block(bx + kAhead, by));
  }

  // The table of rays is larger than the caches: it is on its way while packets are cast.
  static void Prefetch(const RayBlock& rays) {
    __builtin_prefetch(rays.x.data());
    __builtin_prefetch(rays.y.data());
    __builtin_prefetch(rays.z.data());
  }

  size_t RenderBatch(Batch& batch) const {
    if (caster_.splats() != nullptr) return RenderSplats(batch);
    const size_t num_hits =
        caster_.CastBlocks(center_in_world_, std::span(batch.rays_in_world).first(batch.count),
                           std::span(batch.hits).first(batch.count));
    for (size_t i = 0; i < batch.count; ++i) {
      StoreBlock(batch.xs[i], batch.ys[i], batch.rays_in_world[i], batch.hits[i]);
    }
    return num_hits;  // pixels outside the picture have no ray
  }

  using SplatLooks = std::array<SplatLook, RayBlock::kSize>;

  // Splats give depth and color at once, ray by ray.
  size_t RenderSplats(Batch& batch) const {
    size_t num_hits = 0;
    for (size_t i = 0; i < batch.count; ++i) {
      const SplatLooks looks = LookAt(batch.rays_in_world[i]);
      HitBlock& hits = batch.hits[i];
      hits.grazing = 0;
      for (size_t k = 0; k < RayBlock::kSize; ++k) {
        const auto& hit = looks[k].hit;
        hits.ray_t[k] = hit ? static_cast<float>(hit->ray_t) : 0.0f;
        hits.triangle[k] = hit ? hit->triangle : HitBlock::kNoTriangle;
        num_hits += hit ? 1 : 0;
      }
      StoreBlock(batch.xs[i], batch.ys[i], batch.rays_in_world[i], hits, &looks);
    }
    return num_hits;
  }

  SplatLooks LookAt(const RayBlock& rays_in_world) const {
    std::array<Ray, RayBlock::kSize> rays;
    for (size_t i = 0; i < rays.size(); ++i) {
      rays[i] = {center_in_world_, Lane(rays_in_world, i).cast<double>()};
    }
    SplatLooks looks;
    caster_.LookAtSplats(rays, splat_colors_, looks);
    return looks;
  }

  // `looks` is that of splats; else null.
  void StoreBlock(int x0, int y0, const RayBlock& rays_in_world, HitBlock& hits,
                  const SplatLooks* looks = nullptr) const {
    if (hits.grazing != 0) {
      RefineGrazing(x0, y0, hits);
    }
    const int width = std::min(kSide, rays_.width_px() - x0);
    const int height = std::min(kSide, rays_.height_px() - y0);
    alignas(64) BlockValues depth_storage;
    alignas(64) BlockValues distance_storage;
    const float* const depth = Depths(x0, y0, hits, depth_storage);
    const float* const distance = Distances(x0, y0, hits, distance_storage);
    if (options_.depth) StoreBlockOf(depth, x0, y0, width, height, frame_.depth);
    if (options_.distance) StoreBlockOf(distance, x0, y0, width, height, frame_.distance);
    if (options_.points) StorePoints(x0, y0, width, height, rays_in_world, hits);
    if (options_.triangle) {
      StoreBlockOf(hits.triangle.data(), x0, y0, width, height, frame_.triangle);
    }
    if (options_.mask) {
      std::array<uint8_t, RayBlock::kSize> mask;
      std::transform(hits.triangle.begin(), hits.triangle.end(), mask.begin(), [](uint32_t id) {
        return id != HitBlock::kNoTriangle ? uint8_t{255} : uint8_t{0};
      });
      StoreBlockOf(mask.data(), x0, y0, width, height, frame_.mask.data);
    }
    if (refine_ && looks != nullptr) {
      StoreLooks(x0, y0, width, height, rays_in_world, *looks);
    } else if (refine_) {
      StoreRefined(x0, y0, width, height, rays_in_world, hits);
    }
    if (options_.color && !refine_color()) {
      StoreSupersampled(x0, y0, width, height);
    }
  }

  using BlockValues = std::array<float, RayBlock::kSize>;

  // A pinhole's rays have z = 1, so that their ray_t is the depth. A panorama's depth is the
  // distance.
  const float* Depths(int x0, int y0, const HitBlock& hits, BlockValues& storage) const {
    if (!options_.depth || rays_.is_pinhole() || rays_.is_panorama()) return hits.ray_t.data();
    DepthOfBlock(hits, rays_.Block(x0 / kSide, y0 / kSide), storage.data());
    return storage.data();
  }

  const float* Distances(int x0, int y0, const HitBlock& hits, BlockValues& storage) const {
    if (!options_.distance || !rays_.is_pinhole()) return hits.ray_t.data();
    DistanceOfBlock(hits, rays_.ColumnSlopes(x0 / kSide), rays_.RowSlopes(y0 / kSide),
                    storage.data());
    return storage.data();
  }

  // Few pixels; the ray is made again in double.
  void RefineGrazing(int x0, int y0, HitBlock& hits) const {
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      if ((hits.grazing >> i & 1u) == 0) continue;
      const auto k = static_cast<int>(i);
      auto ray = rays_.RayInCam(x0 + k % kSide, y0 + k / kSide);
      if (!ray) continue;
      if (rays_.is_pinhole()) *ray /= ray->z();
      const RayHit hit = caster_.RefineHit(center_in_world_, world_from_cam_ * *ray,
                                           hits.triangle[i], double{hits.ray_t[i]});
      hits.ray_t[i] = static_cast<float>(std::max(hit.ray_t, 0.0));
    }
  }

  template <typename T>
  void StoreBlockOf(const T* values, int x0, int y0, int width, int height,
                    std::vector<T>& map) const {
    T* row = &map[PixelIndex(x0, y0)];
    const auto stride = static_cast<size_t>(rays_.width_px());
    if (width == kSide && height == kSide) {  // counts that the compiler knows
      for (int y = 0; y < kSide; ++y)
        std::copy_n(values + y * kSide, kSide, row + static_cast<size_t>(y) * stride);
      return;
    }
    for (int y = 0; y < height; ++y)
      std::copy_n(values + y * kSide, width, row + static_cast<size_t>(y) * stride);
  }

  void StorePoints(int x0, int y0, int width, int height, const RayBlock& rays_in_world,
                   const HitBlock& hits) const {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const size_t i = LaneAt(x, y);
        Eigen::Map<Eigen::Vector3f> point(&frame_.points[3 * PixelIndex(x0 + x, y0 + y)]);
        if (hits.triangle[i] == HitBlock::kNoTriangle) {
          point.setConstant(std::numeric_limits<float>::quiet_NaN());
          continue;
        }
        const Eigen::Vector3d ray = Lane(rays_in_world, i).cast<double>() * double{hits.ray_t[i]};
        const bool in_camera = options_.normals_in == FrameOptions::NormalsIn::kCamera;
        point = (in_camera ? Eigen::Vector3d(world_from_cam_.transpose() * ray)
                           : Eigen::Vector3d(center_in_world_ + ray))
                    .cast<float>();
      }
    }
  }

  // What needs the triangle itself.
  void StoreRefined(int x0, int y0, int width, int height, const RayBlock& rays_in_world,
                    const HitBlock& hits) const {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const size_t i = LaneAt(x, y);
        const size_t pixel = PixelIndex(x0 + x, y0 + y);
        if (hits.triangle[i] == HitBlock::kNoTriangle) {
          StoreMiss(pixel);
          continue;
        }
        const Eigen::Vector3d direction = Lane(rays_in_world, i).cast<double>();
        RayHit hit =
            caster_.RefineHit(center_in_world_, direction, hits.triangle[i], double{hits.ray_t[i]});
        StoreNormal(pixel, hit, direction);
        if (refine_color()) {
          const double length = direction.norm();
          hit.ray_t *= length;
          StoreColor(pixel, shader_->Color(hit, center_in_world_, direction / length,
                                           rays_.DifferentialAt(x0 + x, y0 + y).SolidAngle()));
        }
      }
    }
  }

  void StoreLooks(int x0, int y0, int width, int height, const RayBlock& rays_in_world,
                  const SplatLooks& looks) const {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const size_t i = LaneAt(x, y);
        const size_t pixel = PixelIndex(x0 + x, y0 + y);
        const Eigen::Vector3d direction = Lane(rays_in_world, i).cast<double>();
        if (looks[i].hit) {
          StoreNormal(pixel, *looks[i].hit, direction);
        } else {
          StoreNoNormal(pixel);
        }
        if (refine_color()) StoreColor(pixel, ColorOf(looks[i], direction));
      }
    }
  }

  Eigen::Vector3f ColorOf(SplatLook look, const Eigen::Vector3d& direction) const {
    const double length = direction.norm();
    if (length == 0) return shader_->background();  // no ray, as outside a lens's domain
    if (look.hit) look.hit->ray_t *= length;
    return shader_->Color(look, center_in_world_, direction / length);
  }

  void StoreNoNormal(size_t pixel) const {
    if (options_.normals) std::fill_n(&frame_.normals[3 * pixel], 3, 0.0f);
    if (options_.incidence) frame_.incidence_deg[pixel] = -1;
  }

  void StoreMiss(size_t pixel) const {
    StoreNoNormal(pixel);
    if (refine_color()) StoreColor(pixel, shader_->background());
  }

  void StoreNormal(size_t pixel, const RayHit& hit, const Eigen::Vector3d& direction) const {
    const double along = hit.normal_in_world.dot(direction);
    if (options_.normals) {
      Eigen::Vector3d normal = along > 0 ? -hit.normal_in_world : hit.normal_in_world;
      if (options_.normals_in == FrameOptions::NormalsIn::kCamera) {
        normal = world_from_cam_.transpose() * normal;
      }
      Eigen::Map<Eigen::Vector3f>(&frame_.normals[3 * pixel]) = normal.cast<float>();
    }
    if (options_.incidence) {
      const double sine = hit.normal_in_world.cross(direction).norm();
      frame_.incidence_deg[pixel] =
          static_cast<float>(std::atan2(sine, std::abs(along)) * kDegPerRad);
    }
  }

  void StoreColor(size_t pixel, const Eigen::Vector3f& rgb) const {
    for (int c = 0; c < 3; ++c) {
      frame_.color.data[3 * pixel + static_cast<size_t>(c)] = NearestByte(rgb[c]);
    }
  }

  // n x n samples per pixel, whose rays are those of the pixel's center, moved by the differential.
  void StoreSupersampled(int x0, int y0, int width, int height) const {
    const int side = options_.color_options.samples_per_pixel_side;
    std::array<Eigen::Vector3f, RayBlock::kSize> sums;
    sums.fill(Eigen::Vector3f::Zero());
    std::array<PixelRays::Differential, RayBlock::kSize> differentials;
    for (int i = 0; i < width * height; ++i) {
      differentials[LaneOf(i, width)] = rays_.DifferentialAt(x0 + i % width, y0 + i / width);
    }
    for (int sample = 0; sample < side * side; ++sample) {
      const int right = sample % side;
      const int down = sample / side;
      const float dx = (static_cast<float>(right) + 0.5f) / static_cast<float>(side) - 0.5f;
      const float dy = (static_cast<float>(down) + 0.5f) / static_cast<float>(side) - 0.5f;
      AddSample(x0, y0, dx, dy, differentials, sums);
    }
    for (int i = 0; i < width * height; ++i) {
      StoreColor(PixelIndex(x0 + i % width, y0 + i / width),
                 sums[LaneOf(i, width)] / static_cast<float>(side * side));
    }
  }

  void AddSample(int x0, int y0, float dx, float dy,
                 const std::array<PixelRays::Differential, RayBlock::kSize>& differentials,
                 std::array<Eigen::Vector3f, RayBlock::kSize>& sums) const {
    RayBlock moved;
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      const auto k = static_cast<int>(i);
      const Eigen::Vector3f center = rays_.UnitRay(x0 + k % kSide, y0 + k / kSide);
      if (center.isZero()) continue;
      const Eigen::Vector3f ray =
          (center + dx * differentials[i].along_x + dy * differentials[i].along_y).normalized();
      moved.x[i] = ray.x();
      moved.y[i] = ray.y();
      moved.z[i] = ray.z();
    }
    RayBlock in_world;
    HitBlock hits;
    RotateBlock(world_from_cam_float_, moved, in_world);
    if (caster_.splats() != nullptr) {
      const SplatLooks looks = LookAt(in_world);
      for (size_t i = 0; i < RayBlock::kSize; ++i) {
        sums[i] += ColorOf(looks[i], Lane(in_world, i).cast<double>());
      }
      return;
    }
    caster_.CastBlocks(center_in_world_, std::span(&in_world, 1), std::span(&hits, 1));
    const int side = options_.color_options.samples_per_pixel_side;
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      if (hits.triangle[i] == HitBlock::kNoTriangle) {
        sums[i] += shader_->background();
        continue;
      }
      const Eigen::Vector3d direction = Lane(in_world, i).cast<double>();
      const RayHit hit =
          caster_.RefineHit(center_in_world_, direction, hits.triangle[i], double{hits.ray_t[i]});
      sums[i] += shader_->Color(hit, center_in_world_, direction,
                                differentials[i].SolidAngle() / (side * side));
    }
  }

  static size_t LaneOf(int i, int width) { return LaneAt(i % width, i / width); }

  static size_t LaneAt(int x, int y) {
    return static_cast<size_t>(y) * RayBlock::kSide + static_cast<size_t>(x);
  }

  size_t PixelIndex(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(rays_.width_px()) + static_cast<size_t>(x);
  }

  // Color of one sample per pixel: that of the pass's own hits.
  bool refine_color() const {
    return options_.color && options_.color_options.samples_per_pixel_side == 1;
  }

  const RayCaster& caster_;
  const FrameOptions& options_;
  const SurfaceShader* shader_;
  bool refine_;
  std::span<const Eigen::Vector3f> splat_colors_;  // as seen from here; empty where none are needed
  const PixelRays& rays_;
  Eigen::Vector3d center_in_world_;
  Eigen::Matrix3d world_from_cam_;
  Eigen::Matrix3f world_from_cam_float_;
  Frame& frame_;
};

void Resize(const FrameOptions& options, int width_px, int height_px, Frame& frame) {
  const size_t pixels = static_cast<size_t>(width_px) * static_cast<size_t>(height_px);
  frame.width_px = width_px;
  frame.height_px = height_px;
  frame.depth.resize(options.depth ? pixels : 0);
  frame.distance.resize(options.distance ? pixels : 0);
  frame.points.resize(options.points ? 3 * pixels : 0);
  frame.normals.resize(options.normals ? 3 * pixels : 0);
  frame.triangle.resize(options.triangle ? pixels : 0);
  frame.incidence_deg.resize(options.incidence ? pixels : 0);
  const auto resize_image = [&](Image& image, bool wanted, int channels) {
    image.width_px = wanted ? width_px : 0;
    image.height_px = wanted ? height_px : 0;
    image.channels = wanted ? channels : 0;
    image.data.resize(wanted ? pixels * static_cast<size_t>(channels) : 0);
  };
  resize_image(frame.color, options.color, 3);
  resize_image(frame.mask, options.mask, 1);
}

}  // namespace

FrameRenderer::FrameRenderer(std::shared_ptr<const RayCaster> caster, const FrameOptions& options) {
  RAYLIFT_CHECK(caster != nullptr);
  RAYLIFT_CHECK(options.color_options.samples_per_pixel_side >= 1);
  impl_ = std::make_unique<Impl>(std::move(caster), options);
}

FrameRenderer::~FrameRenderer() = default;
FrameRenderer::FrameRenderer(FrameRenderer&&) noexcept = default;
FrameRenderer& FrameRenderer::operator=(FrameRenderer&&) noexcept = default;

void FrameRenderer::Render(const PixelRays& rays, const Rigid3& cam_from_world, int threads,
                           Frame& frame) const {
  Resize(impl_->options, rays.width_px(), rays.height_px(), frame);
  std::vector<Eigen::Vector3f> splat_colors;
  if (const Splats* splats = impl_->caster->splats(); splats != nullptr && impl_->options.color) {
    splat_colors = SplatColors(*splats, cam_from_world.OriginInSource(), threads);
  }
  const ViewPass pass(*impl_->caster, impl_->options, impl_->shader ? &*impl_->shader : nullptr,
                      impl_->NeedsRefinedHits(), splat_colors, rays, cam_from_world, frame);
  const int rows = (rays.height_px() + kTileSide - 1) / kTileSide;
  std::atomic<size_t> num_hits{0};
  ParallelFor(static_cast<size_t>(rows), threads, [&](size_t row) {
    num_hits += pass.RenderTileRow(static_cast<int>(row) * kTileSide);
  });
  frame.num_hits = num_hits;
}

namespace {

Frame RenderOne(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                const FrameOptions& options, int threads) {
  // The caster outlives the renderer, which is gone when this returns.
  const std::shared_ptr<const RayCaster> borrowed(std::shared_ptr<void>(), &caster);
  Frame frame;
  FrameRenderer(borrowed, options)
      .Render(PixelRays(camera, threads), cam_from_world, threads, frame);
  return frame;
}

}  // namespace

DepthMap RenderDepth(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                     int threads) {
  FrameOptions options;
  options.depth = true;
  Frame frame = RenderOne(caster, camera, cam_from_world, options, threads);
  return {frame.width_px, frame.height_px, std::move(frame.depth)};
}

Image RenderColor(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                  const ColorOptions& options, int threads) {
  FrameOptions frame_options;
  frame_options.color = true;
  frame_options.color_options = options;
  return std::move(RenderOne(caster, camera, cam_from_world, frame_options, threads).color);
}

}  // namespace raylift
