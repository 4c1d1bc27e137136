// Everything that a camera sees of a scene, in one pass over its pixels: depth, normals, color,
// which triangle, how obliquely.

#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/renderers/pixel_rays.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/image.h"

namespace raylift {

struct ColorOptions {
  enum class Shading {
    kUnlit,      // the surface's own color
    kHeadlight,  // times the cosine to the viewer; what untextured meshes need
    kSun,        // a directional light with shadows, and ambient light
  };
  Shading shading = Shading::kUnlit;
  Eigen::Vector3d sun_direction_in_world{0.3, 0.4, -0.85};  // the way the light travels
  double ambient = 0.45;
  int samples_per_pixel_side = 1;  // n: n x n samples per pixel, on a regular grid
  std::array<uint8_t, 3> background_rgb{0, 0, 0};
  std::array<uint8_t, 3> untextured_rgb{190, 190, 190};

  bool operator==(const ColorOptions&) const = default;
};
template <>
inline constexpr auto kEnumNames<ColorOptions::Shading> =
    std::to_array<EnumName<ColorOptions::Shading>>({
        {ColorOptions::Shading::kUnlit, "unlit"},
        {ColorOptions::Shading::kHeadlight, "headlight"},
        {ColorOptions::Shading::kSun, "sun"},
    });

struct FrameOptions {
  // The maps of a Frame that are made.
  bool depth = false;
  bool distance = false;
  bool points = false;
  bool normals = false;
  bool color = false;
  bool triangle = false;
  bool incidence = false;
  bool mask = false;

  // Points of the world are given from the camera's center on, which Frame::points_origin has: far
  // from the world's origin floats hold these alone.
  bool points_from_center = false;

  enum class NormalsIn { kWorld, kCamera };
  NormalsIn normals_in = NormalsIn::kWorld;  // points as well
  ColorOptions color_options;

  bool operator==(const FrameOptions&) const = default;
};
template <>
inline constexpr auto kEnumNames<FrameOptions::NormalsIn> =
    std::to_array<EnumName<FrameOptions::NormalsIn>>({
        {FrameOptions::NormalsIn::kWorld, "world"},
        {FrameOptions::NormalsIn::kCamera, "camera"},
    });

// Row-major maps of one picture; empty where they were not asked for.
struct Frame {
  int width_px = 0;
  int height_px = 0;
  size_t num_hits = 0;          // pixels that see the mesh
  std::vector<float> depth;     // z along the optical axis (a panorama: the distance); 0 = none
  std::vector<float> distance;  // along the ray; 0 = none
  std::vector<float> points;    // x, y, z per pixel; NaN = none
  // Is to be added to the points.
  Eigen::Vector3d points_origin = Eigen::Vector3d::Zero();
  // x, y, z per pixel: the triangle's unit normal on the side that the camera sees; 0 = none.
  std::vector<float> normals;
  Image color;
  std::vector<uint32_t> triangle;    // HitBlock::kNoTriangle = none
  std::vector<float> incidence_deg;  // 0: seen from straight ahead, 90: grazing; -1 = none
  Image mask;                        // 255 where there is a surface, else 0
};

class FrameRenderer {
 public:
  FrameRenderer(std::shared_ptr<const RayCaster> caster, const FrameOptions& options);
  ~FrameRenderer();
  FrameRenderer(FrameRenderer&&) noexcept;
  FrameRenderer& operator=(FrameRenderer&&) noexcept;

  // Fills `frame`, whose memory is used again. Depth and distance are within 1e-5 of the mesh's as
  // it stands in float, at any incidence. Points that are behind the image plane (lenses of more
  // than 180 degrees) have a distance but a depth of 0. The same bytes for any number of threads,
  // and whatever else is asked for. Thread safe.
  void Render(const PixelRays& rays, const Rigid3& cam_from_world, int threads, Frame& frame) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The background of pictures that people look at.
inline constexpr std::array<uint8_t, 3> kPictureBackground = {222, 226, 232};

// Returns how a surface is shown to people: by a headlight where it has no color of its own.
ColorOptions PictureColors(const RayCaster& caster);

// Short forms for one picture at a time.

// z-depth at every pixel center. Same bytes for any number of threads.
DepthMap RenderDepth(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                     int threads);

// RGB from texture (bilinear), else vertex colors, else `untextured_rgb`.
Image RenderColor(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                  const ColorOptions& options, int threads);

}  // namespace raylift
