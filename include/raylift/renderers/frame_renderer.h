// Renders all that a camera sees of a scene in one pass over its pixels: depth, normals, color,
// triangles, angles of incidence.

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
  // The maps of a Frame that are rendered.
  bool depth = false;
  bool distance = false;
  bool points = false;
  bool normals = false;
  bool color = false;
  bool triangle = false;
  bool incidence = false;
  bool mask = false;

  // Points are relative to the camera's center, which is then Frame::points_origin: far from the
  // world's origin float has too few digits for world coordinates.
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

// Row-major maps of one picture; maps that were not asked for are empty.
struct Frame {
  int width_px = 0;
  int height_px = 0;
  size_t num_hits = 0;          // pixels that see the mesh
  std::vector<float> depth;     // z along the optical axis (a panorama: the distance); 0 = none
  std::vector<float> distance;  // along the ray; 0 = none
  std::vector<float> points;    // x, y, z per pixel; NaN = none
  // The origin to be added to the points, world frame.
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

  // Renders into `frame`, whose memory is reused. Depth and distance are within 1e-5 of those of
  // the mesh as stored in float, at any incidence. Points behind the image plane (lenses of more
  // than 180 degrees) have a distance but a depth of 0. The bytes are the same for any number of
  // threads, and whatever other maps are asked for. Thread safe.
  void Render(const PixelRays& rays, const Rigid3& cam_from_world, int threads, Frame& frame) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The background of pictures that people look at.
inline constexpr std::array<uint8_t, 3> kPictureBackground = {222, 226, 232};

// Returns the colors in which a surface is shown to people: lit by a headlight where it has no
// color of its own.
ColorOptions PictureColors(const RayCaster& caster);

// Short forms for one picture at a time.

// Renders the z-depth at every pixel center. The bytes are the same for any number of threads.
DepthMap RenderDepth(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                     int threads);

// Renders RGB from texture (bilinear), else vertex colors, else `untextured_rgb`.
Image RenderColor(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                  const ColorOptions& options, int threads);

}  // namespace raylift
