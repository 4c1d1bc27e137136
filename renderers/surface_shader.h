// Computes the color of a surface under a light.

#pragma once

#include <vector>

#include "surfaces/texture.h"

#include "raylift/renderers/frame_renderer.h"

namespace raylift {

class SurfaceShader {
 public:
  // `caster` must outlive the shader.
  SurfaceShader(const RayCaster& caster, const ColorOptions& options);

  // Returns RGB in 0..255 of a hit of the unit ray `direction_in_world` from `center_in_world`,
  // which stands for `solid_angle` of the view.
  Eigen::Vector3f Color(const RayHit& hit, const Eigen::Vector3d& center_in_world,
                        const Eigen::Vector3d& direction_in_world, double solid_angle) const;

  // Returns the color of such a ray's look at splats, with the background behind them.
  Eigen::Vector3f Color(const SplatLook& look, const Eigen::Vector3d& center_in_world,
                        const Eigen::Vector3d& direction_in_world) const;

  const Eigen::Vector3f& background() const { return background_; }

 private:
  Eigen::Vector3f OwnColor(const RayHit& hit, double footprint) const;
  double TextureLevel(const RayHit& hit, const Texture& texture, double footprint) const;
  double Light(const RayHit& hit, const Eigen::Vector3d& center_in_world,
               const Eigen::Vector3d& direction_in_world) const;
  double SunLight(const RayHit& hit, const Eigen::Vector3d& center_in_world,
                  const Eigen::Vector3d& direction_in_world) const;

  const RayCaster& caster_;
  const TriangleMesh& mesh_;
  ColorOptions options_;
  Eigen::Vector3d to_sun_;
  Eigen::Vector3f background_;
  std::vector<Texture> textures_;
};

}  // namespace raylift
