#include "raylift/renderers/frame_renderer.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <optional>

#include "block_kernels.h"
#include "surface_shader.h"
#include <Eigen/Geometry>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr int kSide = static_cast<int>(RayBlock::kSide);
constexpr int kTileBlocks = 2;  // per side: tiles of 8 x 8 pixels
constexpr int kTileSide = kTileBlocks * kSide;
constexpr size_t kBlocksPerTile = kTileBlocks * kTileBlocks;
constexpr double kDegPerRad = 180 / std::numbers::pi;

Eigen::Vector3f Lane(const RayBlock& rays, size_t i) { return {rays.x[i], rays.y[i], rays.z[i]}; }

// How the ray changes from pixel to pixel; zero where the lens has no ray beside this one.
struct RayDifferential {
  Eigen::Vector3f along_x = Eigen::Vector3f::Zero();
  Eigen::Vector3f along_y = Eigen::Vector3f::Zero();
};

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

// One view being rendered.
class View {
 public:
  View(const RayCaster& caster, const FrameOptions& options, const SurfaceShader* shader,
       bool refine, const PixelRays& rays, const Rigid3& cam_from_world, Frame& frame)
      : caster_(caster),
        options_(options),
        shader_(shader),
        refine_(refine),
        rays_(rays),
        center_in_world_(cam_from_world.OriginInSource()),
        world_from_cam_(cam_from_world.rotation.conjugate().toRotationMatrix()),
        world_from_cam_float_(world_from_cam_.cast<float>()),
        frame_(frame) {}

  // Returns the number of pixels that see the mesh.
  size_t RenderTileRow(int tile_y) const {
    size_t num_hits = 0;
    Tile tile;
    for (int tile_x = 0; tile_x < rays_.width_px(); tile_x += kTileSide) {
      num_hits += RenderTile(tile_x, tile_y, tile);
    }
    return num_hits;
  }

 private:
  struct Tile {
    std::array<RayBlock, kBlocksPerTile> rays_in_world;
    std::array<HitBlock, kBlocksPerTile> hits;
  };

  size_t RenderTile(int tile_x, int tile_y, Tile& tile) const {
    std::array<int, kBlocksPerTile> xs{};
    std::array<int, kBlocksPerTile> ys{};
    size_t count = 0;
    for (int i = 0; i < static_cast<int>(kBlocksPerTile); ++i) {
      const int x = tile_x + i % kTileBlocks * kSide;
      const int y = tile_y + i / kTileBlocks * kSide;
      if (x >= rays_.width_px() || y >= rays_.height_px()) continue;
      RotateBlock(world_from_cam_float_, rays_.Block(x / kSide, y / kSide),
                  tile.rays_in_world[count]);
      xs[count] = x;
      ys[count] = y;
      ++count;
      if (x + kTileSide < rays_.width_px()) {
        Prefetch(rays_.Block((x + kTileSide) / kSide, y / kSide));
      }
    }
    caster_.CastBlocks(center_in_world_, std::span(tile.rays_in_world).first(count),
                       std::span(tile.hits).first(count));
    size_t num_hits = 0;
    for (size_t i = 0; i < count; ++i) {
      num_hits += StoreBlock(xs[i], ys[i], tile.rays_in_world[i], tile.hits[i]);
    }
    return num_hits;
  }

  // The table of rays is larger than the caches: it is on its way while packets are cast.
  static void Prefetch(const RayBlock& rays) {
    __builtin_prefetch(rays.x.data());
    __builtin_prefetch(rays.y.data());
    __builtin_prefetch(rays.z.data());
  }

  size_t StoreBlock(int x0, int y0, const RayBlock& rays_in_world, HitBlock& hits) const {
    const RayBlock& rays_in_cam = rays_.Block(x0 / kSide, y0 / kSide);
    if (hits.grazing != 0) {
      RefineGrazing(x0, y0, hits);
    }
    const int width = std::min(kSide, rays_.width_px() - x0);
    const int height = std::min(kSide, rays_.height_px() - y0);
    alignas(64) std::array<float, RayBlock::kSize> depth;
    if (options_.depth && !rays_.is_panorama()) DepthOfBlock(hits, rays_in_cam, depth.data());
    const float* const depths = rays_.is_panorama() ? hits.ray_t.data() : depth.data();
    for (int y = 0; y < height; ++y) {
      const auto lane = static_cast<size_t>(y * kSide);
      const size_t pixel = PixelIndex(x0, y0 + y);
      if (width == kSide) {
        StoreRow(depths, hits, lane, pixel, static_cast<size_t>(kSide));
      } else {
        StoreRow(depths, hits, lane, pixel, static_cast<size_t>(width));
      }
    }
    if (refine_) {
      StoreRefined(x0, y0, width, height, rays_in_world, hits);
    }
    if (options_.color && !refine_color()) {
      StoreSupersampled(x0, y0, width, height);
    }
    return CountHits(hits);  // pixels outside the picture have no ray
  }

  // Few pixels; the ray is made again in double.
  void RefineGrazing(int x0, int y0, HitBlock& hits) const {
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      if ((hits.grazing >> i & 1u) == 0) continue;
      const auto k = static_cast<int>(i);
      const auto ray = rays_.RayInCam(x0 + k % kSide, y0 + k / kSide);
      if (!ray) continue;
      const RayHit hit = caster_.RefineHit(center_in_world_, world_from_cam_ * *ray,
                                           hits.triangle[i], double{hits.ray_t[i]});
      hits.ray_t[i] = static_cast<float>(std::max(hit.ray_t, 0.0));
    }
  }

  // What the packets' own results give. Inlined, for the constant count of whole blocks.
  [[gnu::always_inline]] void StoreRow(const float* depths, const HitBlock& hits, size_t lane,
                                       size_t pixel, size_t count) const {
    if (options_.depth) {
      std::copy_n(depths + lane, count, &frame_.depth[pixel]);
    }
    if (options_.distance) {
      std::copy_n(&hits.ray_t[lane], count, &frame_.distance[pixel]);
    }
    if (options_.triangle) {
      std::copy_n(&hits.triangle[lane], count, &frame_.triangle[pixel]);
    }
    if (options_.mask) {
      for (size_t i = 0; i < count; ++i) {
        frame_.mask.data[pixel + i] =
            hits.triangle[lane + i] != HitBlock::kNoTriangle ? uint8_t{255} : uint8_t{0};
      }
    }
  }

  // What needs the triangle itself.
  void StoreRefined(int x0, int y0, int width, int height, const RayBlock& rays_in_world,
                    const HitBlock& hits) const {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const auto i = static_cast<size_t>(y * kSide + x);
        const size_t pixel = PixelIndex(x0 + x, y0 + y);
        if (hits.triangle[i] == HitBlock::kNoTriangle) {
          StoreMiss(pixel);
          continue;
        }
        const Eigen::Vector3d direction = Lane(rays_in_world, i).cast<double>();
        const RayHit hit =
            caster_.RefineHit(center_in_world_, direction, hits.triangle[i], double{hits.ray_t[i]});
        StoreNormal(pixel, hit, direction);
        if (refine_color()) {
          StoreColor(pixel, shader_->Color(hit, center_in_world_, direction,
                                           SolidAngle(Differential(x0 + x, y0 + y))));
        }
      }
    }
  }

  void StoreMiss(size_t pixel) const {
    if (options_.normals) std::fill_n(&frame_.normals[3 * pixel], 3, 0.0f);
    if (options_.incidence) frame_.incidence_deg[pixel] = -1;
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
      frame_.color.data[3 * pixel + static_cast<size_t>(c)] =
          static_cast<uint8_t>(std::clamp(rgb[c], 0.0f, 255.0f) + 0.5f);
    }
  }

  // n x n samples per pixel, whose rays are those of the pixel's centre, moved by the differential.
  void StoreSupersampled(int x0, int y0, int width, int height) const {
    const int side = options_.color_options.samples_per_pixel_side;
    std::array<Eigen::Vector3f, RayBlock::kSize> sums;
    sums.fill(Eigen::Vector3f::Zero());
    std::array<RayDifferential, RayBlock::kSize> differentials;
    for (int i = 0; i < width * height; ++i) {
      differentials[LaneOf(i, width)] = Differential(x0 + i % width, y0 + i / width);
    }
    for (int sample = 0; sample < side * side; ++sample) {
      const float dx = (static_cast<float>(sample % side) + 0.5f) / static_cast<float>(side) - 0.5f;
      const float dy = (static_cast<float>(sample / side) + 0.5f) / static_cast<float>(side) - 0.5f;
      AddSample(x0, y0, dx, dy, differentials, sums);
    }
    for (int i = 0; i < width * height; ++i) {
      StoreColor(PixelIndex(x0 + i % width, y0 + i / width),
                 sums[LaneOf(i, width)] / static_cast<float>(side * side));
    }
  }

  void AddSample(int x0, int y0, float dx, float dy,
                 const std::array<RayDifferential, RayBlock::kSize>& differentials,
                 std::array<Eigen::Vector3f, RayBlock::kSize>& sums) const {
    const RayBlock& centers = rays_.Block(x0 / kSide, y0 / kSide);
    RayBlock moved;
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      const Eigen::Vector3f center = Lane(centers, i);
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
                                SolidAngle(differentials[i]) / (side * side));
    }
  }

  static size_t LaneOf(int i, int width) {
    return static_cast<size_t>(i / width * kSide + i % width);
  }

  RayDifferential Differential(int x, int y) const {
    const Eigen::Vector3f center = RayAt(x, y);
    return {Slope(center, RayAt(x - 1, y), RayAt(x + 1, y)),
            Slope(center, RayAt(x, y - 1), RayAt(x, y + 1))};
  }

  Eigen::Vector3f RayAt(int x, int y) const {
    if (x < 0 || y < 0 || x >= rays_.width_px() || y >= rays_.height_px()) {
      return Eigen::Vector3f::Zero();
    }
    return Lane(rays_.Block(x / kSide, y / kSide),
                static_cast<size_t>(y % kSide * kSide + x % kSide));
  }

  static Eigen::Vector3f Slope(const Eigen::Vector3f& here, const Eigen::Vector3f& before,
                               const Eigen::Vector3f& after) {
    if (!before.isZero() && !after.isZero()) return 0.5f * (after - before);
    if (!after.isZero()) return after - here;
    if (!before.isZero()) return here - before;
    return Eigen::Vector3f::Zero();
  }

  static double SolidAngle(const RayDifferential& differential) {
    return double{differential.along_x.cross(differential.along_y).norm()};
  }

  size_t PixelIndex(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(rays_.width_px()) + static_cast<size_t>(x);
  }

  // Colour of one sample per pixel: that of the pass's own hits.
  bool refine_color() const {
    return options_.color && options_.color_options.samples_per_pixel_side == 1;
  }

  const RayCaster& caster_;
  const FrameOptions& options_;
  const SurfaceShader* shader_;
  bool refine_;
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
  const View view(*impl_->caster, impl_->options, impl_->shader ? &*impl_->shader : nullptr,
                  impl_->NeedsRefinedHits(), rays, cam_from_world, frame);
  const int rows = (rays.height_px() + kTileSide - 1) / kTileSide;
  std::atomic<size_t> num_hits{0};
  ParallelFor(static_cast<size_t>(rows), threads, [&](size_t row) {
    num_hits += view.RenderTileRow(static_cast<int>(row) * kTileSide);
  });
  frame.num_hits = num_hits;
}

}  // namespace raylift
