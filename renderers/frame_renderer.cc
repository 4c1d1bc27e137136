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
#include <optional>
#include <span>

#include "renderers/block_kernels.h"
#include "renderers/frame_maps.h"
#include "renderers/splat_blend.h"
#include "renderers/surface_shader.h"
#include <Eigen/Geometry>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr int kTileBlocks = 2;  // per side: tiles of 8 x 8 pixels
constexpr int kTileSide = kTileBlocks * kBlockSide;
constexpr size_t kBlocksPerTile = size_t{kTileBlocks} * kTileBlocks;
// Tiles in a row that are cast at a time; what they need stays in the first cache.
constexpr size_t kTilesAtATime = 8;

}  // namespace

struct FrameRenderer::Impl {
  Impl(std::shared_ptr<const RayCaster> caster_in, const FrameOptions& options_in)
      : caster(std::move(caster_in)), options(options_in) {
    if (options.color) shader.emplace(*caster, options.color_options);
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

// Computes the colors of a view's pixels, and the rays' looks at splats.
class ViewColors {
 public:
  // `shader` may be null where no color is asked for.
  ViewColors(const RayCaster& caster, const ColorOptions& options, const SurfaceShader* shader,
             std::span<const Eigen::Vector3f> splat_colors, const PixelRays& rays,
             const FrameMaps& maps)
      : caster_(caster),
        side_(options.samples_per_pixel_side),
        shader_(shader),
        splat_colors_(splat_colors),
        rays_(rays),
        maps_(maps),
        world_from_cam_float_(maps.world_from_cam().cast<float>()) {}

  using SplatLooks = std::array<SplatLook, RayBlock::kSize>;

  SplatLooks LookAt(const RayBlock& rays_in_world) const {
    std::array<Ray, RayBlock::kSize> rays;
    for (size_t i = 0; i < rays.size(); ++i) {
      rays[i] = {maps_.center_in_world(), Lane(rays_in_world, i).cast<double>()};
    }
    SplatLooks looks;
    caster_.LookAtSplats(rays, splat_colors_, looks);
    return looks;
  }

  Eigen::Vector3f ColorOf(SplatLook look, const Eigen::Vector3d& direction) const {
    const double length = direction.norm();
    if (length == 0) return background();  // no ray, as outside a lens's domain
    if (look.hit) look.hit->ray_t *= length;
    return shader_->Color(look, maps_.center_in_world(), direction / length);
  }

  // Returns the color of a pixel from its only sample.
  Eigen::Vector3f ColorOf(int x, int y, RayHit hit, const Eigen::Vector3d& direction) const {
    const double length = direction.norm();
    hit.ray_t *= length;
    return shader_->Color(hit, maps_.center_in_world(), direction / length,
                          rays_.DifferentialAt(x, y).SolidAngle());
  }

  const Eigen::Vector3f& background() const { return shader_->background(); }

  // Stores the color of n x n samples per pixel, whose rays are those of the pixel's center, moved
  // by the differential.
  void StoreSupersampled(const BlockArea& area) const {
    std::array<Eigen::Vector3f, RayBlock::kSize> sums;
    sums.fill(Eigen::Vector3f::Zero());
    Differentials differentials;
    area.ForEachPixel(
        [&](size_t i, int x, int y) { differentials[i] = rays_.DifferentialAt(x, y); });
    for (int sample = 0; sample < side_ * side_; ++sample) {
      const int right = sample % side_;
      const int down = sample / side_;
      const float dx = (static_cast<float>(right) + 0.5f) / static_cast<float>(side_) - 0.5f;
      const float dy = (static_cast<float>(down) + 0.5f) / static_cast<float>(side_) - 0.5f;
      AddSample(area, dx, dy, differentials, sums);
    }
    area.ForEachPixel([&](size_t i, int x, int y) {
      maps_.StoreColor(x, y, sums[i] / static_cast<float>(side_ * side_));
    });
  }

 private:
  using Differentials = std::array<PixelRays::Differential, RayBlock::kSize>;

  void AddSample(const BlockArea& area, float dx, float dy, const Differentials& differentials,
                 std::array<Eigen::Vector3f, RayBlock::kSize>& sums) const {
    RayBlock moved;
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      const auto k = static_cast<int>(i);
      const Eigen::Vector3f center =
          rays_.UnitRay(area.x0 + k % kBlockSide, area.y0 + k / kBlockSide);
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
    const Eigen::Vector3d& center = maps_.center_in_world();
    caster_.CastBlocks(center, std::span(&in_world, 1), std::span(&hits, 1));
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      if (hits.triangle[i] == HitBlock::kNoTriangle) {
        sums[i] += background();
        continue;
      }
      const Eigen::Vector3d direction = Lane(in_world, i).cast<double>();
      const RayHit hit =
          caster_.RefineHit(center, direction, hits.triangle[i], double{hits.ray_t[i]});
      sums[i] +=
          shader_->Color(hit, center, direction, differentials[i].SolidAngle() / (side_ * side_));
    }
  }

  const RayCaster& caster_;
  int side_;
  const SurfaceShader* shader_;
  std::span<const Eigen::Vector3f> splat_colors_;  // as seen from here; empty where none are needed
  const PixelRays& rays_;
  const FrameMaps& maps_;
  Eigen::Matrix3f world_from_cam_float_;
};

// Renders one view: fills the maps of its frame.
class ViewPass {
 public:
  ViewPass(const RayCaster& caster, const FrameOptions& options, const SurfaceShader* shader,
           bool refine, std::span<const Eigen::Vector3f> splat_colors, const PixelRays& rays,
           const Rigid3& cam_from_world, Frame& frame)
      : caster_(caster),
        options_(options),
        refine_(refine),
        rays_(rays),
        maps_(options, rays, cam_from_world, frame),
        colors_(caster, options.color_options, shader, splat_colors, rays, maps_),
        world_from_cam_float_(maps_.world_from_cam().cast<float>()) {}
  ViewPass(const ViewPass&) = delete;  // the colors refer to the maps
  ViewPass& operator=(const ViewPass&) = delete;

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
      const int x = tile_x + i % kTileBlocks * kBlockSide;
      const int y = tile_y + i / kTileBlocks * kBlockSide;
      if (x >= rays_.width_px() || y >= rays_.height_px()) continue;
      TurnBlock(x / kBlockSide, y / kBlockSide, batch.rays_in_world[batch.count]);
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
    if ((bx + kAhead) * kBlockSide < rays_.width_px()) Prefetch(rays_.Block(bx + kAhead, by));
  }

  // The table of rays is larger than the caches: it is on its way while packets are cast.
  static void Prefetch(const RayBlock& rays) {
    __builtin_prefetch(rays.x.data());
    __builtin_prefetch(rays.y.data());
    __builtin_prefetch(rays.z.data());
  }

  size_t RenderBatch(Batch& batch) const {
    if (caster_.splats() != nullptr) return RenderSplats(batch);
    const size_t num_hits = caster_.CastBlocks(maps_.center_in_world(),
                                               std::span(batch.rays_in_world).first(batch.count),
                                               std::span(batch.hits).first(batch.count));
    for (size_t i = 0; i < batch.count; ++i) {
      StoreBlock(batch.xs[i], batch.ys[i], batch.rays_in_world[i], batch.hits[i]);
    }
    return num_hits;  // pixels outside the picture have no ray
  }

  using SplatLooks = ViewColors::SplatLooks;

  // Splats give depth and color at once, ray by ray.
  size_t RenderSplats(Batch& batch) const {
    size_t num_hits = 0;
    for (size_t i = 0; i < batch.count; ++i) {
      const SplatLooks looks = colors_.LookAt(batch.rays_in_world[i]);
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

  // `looks` is that of splats; else null.
  void StoreBlock(int x0, int y0, const RayBlock& rays_in_world, HitBlock& hits,
                  const SplatLooks* looks = nullptr) const {
    if (hits.grazing != 0) RefineGrazing(x0, y0, hits);
    const BlockArea area = maps_.AreaAt(x0, y0);
    maps_.StoreHits(area, rays_in_world, hits);
    if (refine_ && looks != nullptr) {
      StoreLooks(area, rays_in_world, *looks);
    } else if (refine_) {
      StoreRefined(area, rays_in_world, hits);
    }
    if (options_.color && !refine_color()) colors_.StoreSupersampled(area);
  }

  // Refines the hits of grazing rays, which are few: each ray is made again in double.
  void RefineGrazing(int x0, int y0, HitBlock& hits) const {
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      if ((hits.grazing >> i & 1u) == 0) continue;
      const auto k = static_cast<int>(i);
      auto ray = rays_.RayInCam(x0 + k % kBlockSide, y0 + k / kBlockSide);
      if (!ray) continue;
      if (rays_.is_pinhole()) *ray /= ray->z();
      const RayHit hit = caster_.RefineHit(maps_.center_in_world(), maps_.world_from_cam() * *ray,
                                           hits.triangle[i], double{hits.ray_t[i]});
      hits.ray_t[i] = static_cast<float>(std::max(hit.ray_t, 0.0));
    }
  }

  // Fills what needs the triangle itself.
  void StoreRefined(const BlockArea& area, const RayBlock& rays_in_world,
                    const HitBlock& hits) const {
    area.ForEachPixel([&](size_t i, int x, int y) {
      if (hits.triangle[i] == HitBlock::kNoTriangle) {
        maps_.StoreNoNormal(x, y);
        if (refine_color()) maps_.StoreColor(x, y, colors_.background());
        return;
      }
      const Eigen::Vector3d direction = Lane(rays_in_world, i).cast<double>();
      const RayHit hit = caster_.RefineHit(maps_.center_in_world(), direction, hits.triangle[i],
                                           double{hits.ray_t[i]});
      maps_.StoreNormal(x, y, hit, direction);
      if (refine_color()) maps_.StoreColor(x, y, colors_.ColorOf(x, y, hit, direction));
    });
  }

  void StoreLooks(const BlockArea& area, const RayBlock& rays_in_world,
                  const SplatLooks& looks) const {
    area.ForEachPixel([&](size_t i, int x, int y) {
      const Eigen::Vector3d direction = Lane(rays_in_world, i).cast<double>();
      if (looks[i].hit) {
        maps_.StoreNormal(x, y, *looks[i].hit, direction);
      } else {
        maps_.StoreNoNormal(x, y);
      }
      if (refine_color()) maps_.StoreColor(x, y, colors_.ColorOf(looks[i], direction));
    });
  }

  // Says whether the color is that of one sample per pixel, which the pass's own hits give.
  bool refine_color() const {
    return options_.color && options_.color_options.samples_per_pixel_side == 1;
  }

  const RayCaster& caster_;
  const FrameOptions& options_;
  bool refine_;
  const PixelRays& rays_;
  FrameMaps maps_;
  ViewColors colors_;
  Eigen::Matrix3f world_from_cam_float_;
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

ColorOptions PictureColors(const RayCaster& caster) {
  ColorOptions colors;
  colors.background_rgb = kPictureBackground;
  if (!caster.HasColors()) colors.shading = ColorOptions::Shading::kHeadlight;
  return colors;
}

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
