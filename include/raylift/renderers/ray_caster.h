// Casting rays at a mesh, on Embree (3.13 or 4). All coordinates are the world's, in double; the
// recentring that float needs happens inside.

#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/renderers/triangle_mesh.h"

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
  uint32_t triangle;                // index into the mesh's triangles
  Eigen::Vector2d barycentric;      // (u, v): point = (1-u-v) v0 + u v1 + v v2
};

struct RayCasterOptions {
  enum class BuildQuality {
    kLow,     // builds 3 to 4 times faster, traces some 15 % slower
    kMedium,  // for many views
  };
  BuildQuality build_quality = BuildQuality::kMedium;
};

class RayCaster {
 public:
  // Builds the acceleration structure (in robust mode: no ray slips between adjacent triangles).
  // The mesh is shared, not copied (but for its vertices, where their vector has no room for one
  // more, which Embree wants to be readable). std::runtime_error with Embree's text where it fails.
  explicit RayCaster(std::shared_ptr<const TriangleMesh> mesh,
                     const RayCasterOptions& options = {});
  ~RayCaster();
  RayCaster(RayCaster&&) noexcept;
  RayCaster& operator=(RayCaster&&) noexcept;

  const TriangleMesh& mesh() const;

  // The nearest hit of each ray, in order; none where it leaves the scene or is not finite. Both
  // sides of a triangle are hit. A hit's ray_t and barycentric coordinates are refined in double
  // against the triangle's plane. Thread safe.
  std::vector<std::optional<RayHit>> Cast(std::span<const Ray> rays) const;

  // As Cast for rays from one point, several times faster where each 16 in a row run close together
  // (a block of 4 x 4 pixels). A direction of zero length has no hit. At silhouettes a hit may
  // differ from Cast's by the rounding of float. hits.size() == directions_in_world.size().
  void CastCoherent(const Eigen::Vector3d& origin_in_world,
                    std::span<const Eigen::Vector3d> directions_in_world,
                    std::span<std::optional<RayHit>> hits) const;

  // Whether anything lies on the ray beyond its ray_t_near. Thread safe.
  bool IsOccluded(const Ray& ray) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace raylift
