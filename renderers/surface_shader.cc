#include "renderers/surface_shader.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <Eigen/Geometry>

namespace raylift {
namespace {

constexpr double kSigmasOff = 3;

Eigen::Vector3f ToVector(const std::array<uint8_t, 3>& rgb) {
  return {static_cast<float>(rgb[0]), static_cast<float>(rgb[1]), static_cast<float>(rgb[2])};
}

}  // namespace

SurfaceShader::SurfaceShader(const RayCaster& caster, const ColorOptions& options)
    : caster_(caster),
      mesh_(caster.mesh()),
      options_(options),
      to_sun_(-options.sun_direction_in_world.normalized()),
      background_(ToVector(options.background_rgb)) {
  for (const Image& image : mesh_.textures) textures_.emplace_back(image);
}

Eigen::Vector3f SurfaceShader::Color(const RayHit& hit, const Eigen::Vector3d& center_in_world,
                                     const Eigen::Vector3d& direction_in_world,
                                     double solid_angle) const {
  const double cosine = std::abs(hit.normal_in_world.dot(direction_in_world));
  const double footprint = hit.ray_t * hit.ray_t * solid_angle / std::max(cosine, 0.05);
  return OwnColor(hit, footprint) *
         static_cast<float>(Light(hit, center_in_world, direction_in_world));
}

Eigen::Vector3f SurfaceShader::Color(const SplatLook& look, const Eigen::Vector3d& center_in_world,
                                     const Eigen::Vector3d& direction_in_world) const {
  constexpr float kFull = 255;
  const auto behind = static_cast<float>(look.transmittance);
  const Eigen::Vector3f own =
      caster_.HasColors() ? Eigen::Vector3f(kFull * look.color_rgb)
                          : Eigen::Vector3f((1 - behind) * ToVector(options_.untextured_rgb));
  const double light = look.hit ? Light(*look.hit, center_in_world, direction_in_world) : 1.0;
  return static_cast<float>(light) * own + behind * background_;
}

double SurfaceShader::Light(const RayHit& hit, const Eigen::Vector3d& center_in_world,
                            const Eigen::Vector3d& direction_in_world) const {
  switch (options_.shading) {
    case ColorOptions::Shading::kUnlit:
      return 1;
    case ColorOptions::Shading::kHeadlight:
      return std::abs(hit.normal_in_world.dot(direction_in_world));
    case ColorOptions::Shading::kSun:
      return SunLight(hit, center_in_world, direction_in_world);
  }
  return 1;
}

// Returns the unlit color. `footprint` is the area of the surface that the sample covers.
Eigen::Vector3f SurfaceShader::OwnColor(const RayHit& hit, double footprint) const {
  if (const Surfels* surfels = caster_.surfels()) {
    const auto& colors = surfels->colors_rgb;
    return ToVector(colors.empty() ? options_.untextured_rgb : colors[hit.triangle]);
  }
  const auto& [i0, i1, i2] = mesh_.triangles[hit.triangle];
  const auto u = static_cast<float>(hit.barycentric.x());
  const auto v = static_cast<float>(hit.barycentric.y());
  const float w = 1 - u - v;
  const int32_t texture =
      mesh_.triangle_textures.empty() ? -1 : mesh_.triangle_textures[hit.triangle];
  if (texture >= 0) {
    const auto& uvs = mesh_.texture_coordinates;
    const Eigen::Vector2f uv = w * uvs[i0] + u * uvs[i1] + v * uvs[i2];
    const Texture& sampled = textures_[static_cast<size_t>(texture)];
    return sampled.Sample(uv, TextureLevel(hit, sampled, footprint));
  }
  if (!mesh_.vertex_colors_rgb.empty()) {
    const auto& colors = mesh_.vertex_colors_rgb;
    return w * ToVector(colors[i0]) + u * ToVector(colors[i1]) + v * ToVector(colors[i2]);
  }
  return ToVector(options_.untextured_rgb);
}

// Returns half the base-2 logarithm of the texels that the footprint covers.
double SurfaceShader::TextureLevel(const RayHit& hit, const Texture& texture,
                                   double footprint) const {
  const auto& [i0, i1, i2] = mesh_.triangles[hit.triangle];
  const auto& uvs = mesh_.texture_coordinates;
  const Eigen::Vector2f a = uvs[i1] - uvs[i0];
  const Eigen::Vector2f b = uvs[i2] - uvs[i0];
  const double texels =
      std::abs(static_cast<double>(a.x() * b.y() - a.y() * b.x())) * texture.NumTexels();
  const Eigen::Vector3f edge1 = mesh_.vertices[i1] - mesh_.vertices[i0];
  const Eigen::Vector3f edge2 = mesh_.vertices[i2] - mesh_.vertices[i0];
  const double area = edge1.cross(edge2).cast<double>().norm();
  const double covered = footprint * texels / area;
  return covered > 1 ? 0.5 * std::log2(covered) : 0.0;
}

// Returns ambient light, and the sun's where the side that the viewer sees is turned to it and
// nothing stands between.
double SurfaceShader::SunLight(const RayHit& hit, const Eigen::Vector3d& center_in_world,
                               const Eigen::Vector3d& direction_in_world) const {
  const bool is_front = hit.normal_in_world.dot(direction_in_world) < 0;
  const Eigen::Vector3d normal = is_front ? hit.normal_in_world : -hit.normal_in_world;
  const double cosine = normal.dot(to_sun_);
  if (cosine <= 0) return options_.ambient;
  const Eigen::Vector3d point = center_in_world + hit.ray_t * direction_in_world;
  // Off the surface by more than float resolves at this place,
  // and off discs and splats by more than they scatter.
  const double lift =
      1e-5 * ((point - mesh_.origin_in_world).norm() + hit.ray_t) + kSigmasOff * hit.sigma;
  if (caster_.IsOccluded({point + lift * normal, to_sun_})) return options_.ambient;
  return options_.ambient + (1 - options_.ambient) * cosine;
}

}  // namespace raylift
