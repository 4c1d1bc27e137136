// What a camera sees of a mesh: depth and colour, through the true lens model.

#pragma once

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/depth_map.h"
#include "raylift/scene/image.h"

namespace raylift {

// z-depth at every pixel centre. Same bytes for any number of threads.
DepthMap RenderDepth(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                     int threads);

struct ColorOptions {
  enum class Shading {
    kUnlit,      // the surface's own colour
    kHeadlight,  // times the cosine to the viewer; what untextured meshes need
    kSun,        // a directional light with shadows, and ambient light
  };
  Shading shading = Shading::kUnlit;
  Eigen::Vector3d sun_direction_in_world{0.3, 0.4, -0.85};  // the way the light travels
  double ambient = 0.45;
  int samples_per_pixel_side = 1;  // n: n x n samples per pixel, on a regular grid
  std::array<uint8_t, 3> background_rgb{0, 0, 0};
  std::array<uint8_t, 3> untextured_rgb{190, 190, 190};
};

// RGB from texture (bilinear), else vertex colours, else `untextured_rgb`.
Image RenderColor(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                  const ColorOptions& options, int threads);

}  // namespace raylift
