// Casts rays at a mesh, at the discs of a point cloud or at Gaussian splats, with Embree 3 (from
// 3.12 on) or 4. All coordinates are the world's, in double; the recentering that float needs is
// done inside.

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/base/enum_names.h"
#include "raylift/surfaces/point_cloud.h"
#include "raylift/surfaces/splats.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

// A ray leaves `origin_in_world` along `direction_in_world` (any length; ray_t counts in it).
struct Ray {
  Eigen::Vector3d origin_in_world;
  Eigen::Vector3d direction_in_world;
  double ray_t_near = 0;
};

struct RayHit {
  double ray_t;                     // point = origin + ray_t * direction
  Eigen::Vector3d normal_in_world;  // unit, geometric, by the triangle's winding
  // Index into the mesh's triangles, the surfels' discs or the splats' Gaussians.
  uint32_t triangle;
  Eigen::Vector2d barycentric;  // (u, v): point = (1-u-v) v0 + u v1 + v v2; else zero
  double sigma = 0;             // of a surface of discs or splats, along its normal
};

// The look of a ray at splats: hit, color and transmittance.
struct SplatLook {
  std::optional<RayHit> hit;  // of the Gaussian with the largest weight
  Eigen::Vector3f color_rgb = Eigen::Vector3f::Zero();
  double transmittance = 1;  // the share of what is behind that is still seen
};

enum class SurfaceKind { kMesh, kCloud, kSplats };
template <>
inline constexpr auto kEnumNames<SurfaceKind> = std::to_array<EnumName<SurfaceKind>>({
    {SurfaceKind::kMesh, "mesh"},
    {SurfaceKind::kCloud, "point cloud"},
    {SurfaceKind::kSplats, "scene of splats"},
});

struct RayCasterOptions {
  enum class BuildQuality {
    kLow,     // builds 3 to 4 times faster, traces some 15 % slower
    kMedium,  // for many views
  };
  BuildQuality build_quality = BuildQuality::kMedium;

  // Is called from any thread, one call at a time, with the share of the build that is done.
  std::function<void(double)> on_build_progress = {};
};
template <>
inline constexpr auto kEnumNames<RayCasterOptions::BuildQuality> =
    std::to_array<EnumName<RayCasterOptions::BuildQuality>>({
        {RayCasterOptions::BuildQuality::kLow, "low"},
        {RayCasterOptions::BuildQuality::kMedium, "medium"},
    });

// The directions of 16 rays from one point, in float, as the hardware traces them: those of a block
// of 4 x 4 pixels, row by row. A direction whose length is zero or not finite is no ray.
struct alignas(64) RayBlock {
  static constexpr size_t kSide = 4;
  static constexpr size_t kSize = kSide * kSide;
  std::array<float, kSize> x{};
  std::array<float, kSize> y{};
  std::array<float, kSize> z{};
};

// The hits of a RayBlock.
struct alignas(64) HitBlock {
  static constexpr uint32_t kNoTriangle = 0xffffffffu;
  std::array<float, RayBlock::kSize> ray_t;        // in lengths of the ray's direction; 0: no hit
  std::array<uint32_t, RayBlock::kSize> triangle;  // kNoTriangle where nothing is hit
  // Bit i says that ray i grazes its triangle, so that the rounding of its direction moves the hit
  // by more than a few 1e-6 of its distance; RefineHit() with the direction in double corrects it.
  uint32_t grazing;
};

class RayCaster {
 public:
  // Builds the acceleration structure (in robust mode: no ray slips between adjacent triangles).
  // The mesh is shared, not copied (but for its vertices, where their vector has no room for one
  // more, which Embree wants to be readable). Throws std::runtime_error with Embree's text where it
  // fails.
  explicit RayCaster(std::shared_ptr<const TriangleMesh> mesh,
                     const RayCasterOptions& options = {});
  // Casts rays at surfels. Where a ray passes through several discs that are one surface within
  // their scatter, and their centers surround it, it hits the mean of their planes, by their
  // precision; the hit is that of the disc whose center is the closest to it. The surfels are
  // shared as the mesh is.
  explicit RayCaster(std::shared_ptr<const Surfels> surfels, const RayCasterOptions& options = {});
  // Casts rays at splats by the equations of splats.h. Their surface is at `depth`; its normal is
  // the mean of the Gaussians' shortest axes, turned against the ray, and its sigma is the spread
  // of their t.
  RayCaster(std::shared_ptr<const Splats> splats, SplatDepth depth,
            const RayCasterOptions& options = {});
  ~RayCaster();
  RayCaster(RayCaster&&) noexcept;
  RayCaster& operator=(RayCaster&&) noexcept;

  // Returns the mesh; an empty one where the rays are cast at surfels or splats.
  const TriangleMesh& mesh() const;
  const Surfels* surfels() const;  // null where they are cast at something else
  const Splats* splats() const;    // the same
  SplatDepth splat_depth() const;
  SurfaceKind kind() const;
  // Returns whether hits have a sigma: at surfels and splats, whose hits need no refinement.
  bool HitsHaveSigma() const;
  // Returns whether the surface has colors of its own.
  bool HasColors() const;

  // Returns the nearest hit of each ray, in order; nullopt where it leaves the scene or is not
  // finite. Both sides of a triangle are hit. A hit's ray_t and barycentric coordinates are refined
  // in double against the triangle's plane. Thread safe.
  std::vector<std::optional<RayHit>> Cast(std::span<const Ray> rays) const;

  // Casts rays from one point, several times faster than Cast() where the rays of a block run close
  // together. The results may differ from those of Cast() by the rounding of float, and at
  // silhouettes. hits.size() == rays.size(). Returns how many rays hit something. Thread safe.
  size_t CastBlocks(const Eigen::Vector3d& origin_in_world, std::span<const RayBlock> rays,
                    std::span<HitBlock> hits) const;

  // Returns, in double, the hit of a ray that is known to hit `triangle` at about `coarse_t` (in
  // units of the direction's length). At surfels and splats the ray is cast anew.
  RayHit RefineHit(const Eigen::Vector3d& origin_in_world,
                   const Eigen::Vector3d& direction_in_world, uint32_t triangle,
                   double coarse_t) const;

  // Returns whether anything lies on the ray beyond its ray_t_near. Thread safe.
  bool IsOccluded(const Ray& ray) const;

  // Computes what each ray sees of splats. `colors_rgb` has one color for each Gaussian as seen
  // from the rays' origin (SplatColors), or is empty. looks.size() == rays.size(). Thread safe.
  void LookAtSplats(std::span<const Ray> rays, std::span<const Eigen::Vector3f> colors_rgb,
                    std::span<SplatLook> looks) const;

  // Returns the size of the acceleration structure, without the mesh, surfels or splats.
  size_t MemoryBytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Hashes all that can be seen of the surface. The result does not depend on the number of threads.
uint64_t SurfaceHash(const RayCaster& scene, int threads);

}  // namespace raylift
