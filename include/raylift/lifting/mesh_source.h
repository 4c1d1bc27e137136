// Geometry from a mesh: the ray of a reference pixel, through the true lens model, cast at it.

#pragma once

#include <memory>

#include "raylift/lifting/geometry_source.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {

class MeshSource final : public GeometrySource {
 public:
  MeshSource(std::string description, std::shared_ptr<const RayCaster> caster);

  std::string Description() const override;
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override;

 private:
  std::string description_;
  std::shared_ptr<const RayCaster> caster_;
};

}  // namespace raylift
