// Lifts by a mesh, a point cloud or Gaussian splats: casts the ray of a reference pixel, through
// the true lens model, at it. Points of clouds and splats come with the noise of their surface.

#pragma once

#include <memory>

#include "raylift/lifting/geometry_source.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {

struct MeshOptions {
  SurfaceLimits limits;
  // Radius of four more rays around a keypoint, which tell the depth jump there if the limits ask
  // for it. Where one of them leaves the mesh, the jump is infinite.
  double jump_radius_px = 2;
};

class MeshSource final : public GeometrySource {
 public:
  MeshSource(std::string description, std::shared_ptr<const RayCaster> caster,
             const MeshOptions& options = {});

  std::string Description() const override;
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override;

 private:
  std::string description_;
  std::shared_ptr<const RayCaster> caster_;
  MeshOptions options_;
};

}  // namespace raylift
