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
  Eigen::Vector2f barycentric;      // (u, v): point = (1-u-v) v0 + u v1 + v v2
};

class RayCaster {
 public:
  // Builds the acceleration structure (in robust mode: no ray slips between adjacent triangles).
  // The mesh is shared, not copied.
  explicit RayCaster(std::shared_ptr<const TriangleMesh> mesh);
  ~RayCaster();
  RayCaster(RayCaster&&) noexcept;
  RayCaster& operator=(RayCaster&&) noexcept;

  const TriangleMesh& mesh() const;

  // The nearest hit of each ray, in order; none where it leaves the scene. A hit's ray_t is
  // refined in double against the triangle's plane. Thread safe.
  std::vector<std::optional<RayHit>> Cast(std::span<const Ray> rays) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace raylift
