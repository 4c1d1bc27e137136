#include "raylift/lifting/mesh_source.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "base/constants.h"
#include <Eigen/Geometry>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// Pixels that are lifted at once: their rays and hits stay in the fastest cache.
constexpr size_t kBatch = 128;

struct PixelRay {
  Eigen::Vector3d in_cam;  // unit
  Eigen::Vector3d in_world;
  uint32_t pixel;  // its index
};

// A triangle that a ray hits at about this distance, if it hits one.
struct CoarseHit {
  uint32_t triangle = HitBlock::kNoTriangle;
  double ray_t = 0;

  bool IsHit() const { return triangle != HitBlock::kNoTriangle; }
};

// Lifts pixels of one reference, some at a time. Rays that follow each other should run close
// together: they are cast as blocks.
class ReferenceLifter {
 public:
  ReferenceLifter(const RayCaster& caster, const PosedImage& reference, const MeshOptions& options)
      : caster_(caster),
        camera_(reference.camera),
        center_in_world_(reference.cam_from_world.OriginInSource()),
        world_from_cam_(reference.cam_from_world.rotation.conjugate().toRotationMatrix()),
        near_z_(options.limits.near_z),
        jump_radius_px_(options.jump_radius_px) {}

  // Sets the points of the pixels `indices`; none where there is no ray or no surface.
  void Lift(std::span<const Eigen::Vector2d> pixels, std::span<const uint32_t> indices,
            std::span<std::optional<SurfacePoint>> points) {
    rays_.clear();
    for (const uint32_t i : indices) AddRay(pixels[i], i);
    if (caster_.HitsHaveSigma()) {
      const auto hits = CastOneByOne();
      for (size_t k = 0; k < hits.size(); ++k) {
        if (hits[k]) points[rays_[k].pixel] = MakeSurfacePoint(rays_[k], *hits[k]);
      }
      return;
    }
    Cast();
    PrefetchVertices();
    for (size_t k = 0; k < rays_.size(); ++k) {
      if (!hits_[k].IsHit()) continue;
      const RayHit hit =
          caster_.RefineHit(center_in_world_, rays_[k].in_world, hits_[k].triangle, hits_[k].ray_t);
      if (hit.ray_t > 0) points[rays_[k].pixel] = MakeSurfacePoint(rays_[k], hit);
    }
  }

  // Sets `depth_jump` of these pixels' points.
  void MeasureJumps(std::span<const Eigen::Vector2d> pixels, std::span<const uint32_t> indices,
                    std::span<std::optional<SurfacePoint>> points) {
    const double r = jump_radius_px_;
    const std::array<Eigen::Vector2d, 4> offsets = {Eigen::Vector2d(r, 0), Eigen::Vector2d(0, r),
                                                    Eigen::Vector2d(-r, 0), Eigen::Vector2d(0, -r)};
    rays_.clear();
    for (const uint32_t i : indices) {
      if (!points[i]) continue;
      points[i]->depth_jump = 0;
      for (const Eigen::Vector2d& offset : offsets) AddRay(pixels[i] + offset, i);
    }
    Cast();
    for (size_t k = 0; k < rays_.size(); ++k) {
      SurfacePoint& point = *points[rays_[k].pixel];
      point.depth_jump = std::max(*point.depth_jump, JumpTo(point, rays_[k], hits_[k]));
    }
  }

 private:
  void AddRay(const Eigen::Vector2d& pixel, uint32_t index) {
    const auto ray_in_cam = camera_.RayInCam(pixel);
    if (ray_in_cam) rays_.push_back({*ray_in_cam, world_from_cam_ * *ray_in_cam, index});
  }

  // Sets hits_ of rays_. Blocks know no near limit.
  void Cast() {
    hits_.assign(rays_.size(), CoarseHit());
    if (near_z_ > 0) {
      const auto hits = CastOneByOne();
      for (size_t k = 0; k < hits.size(); ++k) {
        if (hits[k]) hits_[k] = {hits[k]->triangle, hits[k]->ray_t};
      }
    } else {
      CastAsBlocks();
    }
  }

  std::vector<std::optional<RayHit>> CastOneByOne() const {
    std::vector<Ray> rays;
    rays.reserve(rays_.size());
    for (const PixelRay& ray : rays_) {
      const double depth = camera_.DepthOf(ray.in_cam);
      const double ray_t_near = depth > 0 ? near_z_ / depth : 0;
      rays.push_back({center_in_world_, ray.in_world, ray_t_near});
    }
    return caster_.Cast(rays);
  }

  void CastAsBlocks() {
    constexpr size_t kSize = RayBlock::kSize;
    const size_t num_blocks = (rays_.size() + kSize - 1) / kSize;
    ray_blocks_.assign(num_blocks, RayBlock());
    hit_blocks_.resize(num_blocks);
    for (size_t k = 0; k < rays_.size(); ++k) {
      const Eigen::Vector3f direction = rays_[k].in_world.cast<float>();
      RayBlock& block = ray_blocks_[k / kSize];
      block.x[k % kSize] = direction.x();
      block.y[k % kSize] = direction.y();
      block.z[k % kSize] = direction.z();
    }
    caster_.CastBlocks(center_in_world_, ray_blocks_, hit_blocks_);
    for (size_t k = 0; k < rays_.size(); ++k) {
      const HitBlock& block = hit_blocks_[k / kSize];
      hits_[k] = {block.triangle[k % kSize], double{block.ray_t[k % kSize]}};
    }
  }

  // The vertices of a large mesh are rarely in the cache.
  void PrefetchVertices() const {
    const TriangleMesh& mesh = caster_.mesh();
    for (const CoarseHit& hit : hits_) {
      if (!hit.IsHit()) continue;
      for (const uint32_t index : mesh.triangles[hit.triangle]) {
        __builtin_prefetch(&mesh.vertices[index]);
      }
    }
  }

  SurfacePoint MakeSurfacePoint(const PixelRay& ray, const RayHit& hit) const {
    SurfacePoint point;
    point.point_in_world = center_in_world_ + hit.ray_t * ray.in_world;
    const double along = hit.normal_in_world.dot(ray.in_world);
    point.back_face = along > 0;
    point.normal_in_world = point.back_face ? -hit.normal_in_world : hit.normal_in_world;
    point.depth_z = hit.ray_t * camera_.DepthOf(ray.in_cam);
    const double sine = hit.normal_in_world.cross(ray.in_world).norm();
    point.incidence_deg = std::atan2(sine, std::abs(along)) * kDegPerRad;
    if (caster_.HitsHaveSigma()) {
      point.point_sigma = hit.sigma / std::abs(along);  // along the ray
    }
    return point;
  }

  // Returns how far the hit of a neighboring ray (none: it leaves the scene) is from the point's
  // plane.
  double JumpTo(const SurfacePoint& point, const PixelRay& ray, const CoarseHit& hit) const {
    if (!hit.IsHit()) return std::numeric_limits<double>::infinity();
    const Eigen::Vector3d point_from_center = point.point_in_world - center_in_world_;
    const double on_plane =
        point_from_center.dot(point.normal_in_world) / ray.in_world.dot(point.normal_in_world);
    // Where the ray runs along the plane or away from it, compare with the point itself.
    const double expected =
        on_plane > 0 && std::isfinite(on_plane) ? on_plane : point_from_center.norm();
    return std::abs(hit.ray_t - expected) / std::min(hit.ray_t, expected);
  }

  const RayCaster& caster_;
  const Camera& camera_;
  Eigen::Vector3d center_in_world_;
  Eigen::Matrix3d world_from_cam_;
  double near_z_;
  double jump_radius_px_;
  // The memory of the current batch is kept for the next one.
  std::vector<PixelRay> rays_;
  std::vector<CoarseHit> hits_;
  std::vector<RayBlock> ray_blocks_;
  std::vector<HitBlock> hit_blocks_;
};

constexpr uint32_t kSide = 64;  // cells

// Returns the bits of a number below 2^8, with zeros between them.
uint32_t SpreadBits(uint32_t value) {
  value = (value | value << 4) & 0x0f0fu;
  value = (value | value << 2) & 0x3333u;
  return (value | value << 1) & 0x5555u;
}

// Returns the cell of a coordinate; NaN falls into cell 0.
uint32_t CellAlong(double cells) {
  return cells > 0 ? static_cast<uint32_t>(std::min<double>(cells, kSide - 1)) : 0;
}

// Returns the pixels' indices along a Z-shaped curve through the cells of a grid over the image, in
// the given order within a cell; pixels outside count as at the border. Rays through neighbors meet
// the same parts of a mesh, which are still in the cache, and can be cast in blocks.
std::vector<uint32_t> OrderAlongCurve(const Camera& camera,
                                      std::span<const Eigen::Vector2d> pixels) {
  if (pixels.size() == 1) return {0};
  const Eigen::Vector2d cells_per_px(kSide / static_cast<double>(camera.width_px()),
                                     kSide / static_cast<double>(camera.height_px()));
  std::vector<uint32_t> cell_of_pixel;
  cell_of_pixel.reserve(pixels.size());
  std::array<uint32_t, size_t{kSide} * kSide + 1> next{};  // place of each cell's next pixel
  for (const Eigen::Vector2d& pixel : pixels) {
    const uint32_t cell = SpreadBits(CellAlong(pixel.x() * cells_per_px.x())) |
                          SpreadBits(CellAlong(pixel.y() * cells_per_px.y())) << 1;
    cell_of_pixel.push_back(cell);
    ++next[cell + 1];
  }
  for (size_t cell = 0; cell + 1 < next.size(); ++cell) next[cell + 1] += next[cell];
  std::vector<uint32_t> order(pixels.size());
  for (uint32_t i = 0; i < pixels.size(); ++i) order[next[cell_of_pixel[i]]++] = i;
  return order;
}

}  // namespace

MeshSource::MeshSource(std::string description, std::shared_ptr<const RayCaster> caster,
                       const MeshOptions& options)
    : description_(std::move(description)), caster_(std::move(caster)), options_(options) {
  RAYLIFT_CHECK(caster_ != nullptr);
}

std::string MeshSource::Description() const { return description_; }

std::vector<std::optional<SurfacePoint>> MeshSource::Lift(
    const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const {
  std::vector<std::optional<SurfacePoint>> points(pixels.size());
  const std::vector<uint32_t> order = OrderAlongCurve(reference.camera, pixels);
  ReferenceLifter lifter(*caster_, reference, options_);
  for (size_t begin = 0; begin < pixels.size(); begin += kBatch) {
    const auto indices = std::span(order).subspan(begin, std::min(kBatch, pixels.size() - begin));
    lifter.Lift(pixels, indices, points);
    if (std::isfinite(options_.limits.max_depth_jump)) {
      lifter.MeasureJumps(pixels, indices, points);
    }
    for (const uint32_t i : indices) {
      if (points[i] && !options_.limits.Keep(*points[i])) points[i].reset();
    }
  }
  return points;
}

}  // namespace raylift
