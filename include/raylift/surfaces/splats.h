// Gaussian splats: a scene as fuzzy ellipsoids (Kerbl et al., "3D Gaussian Splatting for Real-Time
// Radiance Field Rendering", 2023) or discs (Huang et al., "2D Gaussian Splatting for Geometrically
// Accurate Radiance Fields", 2024), trained on photographs.
//
// They are looked at ray by ray, as Moenne-Loccoz et al. do ("3D Gaussian Ray Tracing", 2024), so
// that any lens sees the same scene. With the ray o + t d, the mean m and S the inverse covariance,
// a Gaussian stands where it is the densest on the ray, and covers what it has there:
//
//   t = d^T S (m - o) / d^T S d,
//   alpha = min(0.99, opacity exp(-(o + t d - m)^T S (o + t d - m) / 2))
//
// A disc is what an ellipsoid becomes as its third axis vanishes: t is where the ray meets its
// plane. Gaussians with alpha >= 1/255 are blended by their t, from front to back: each with the
// weight w = alpha T, which leaves T (1 - alpha) of the transmittance T. The first one that would
// leave less than 1e-4, and all behind it, are not there (Kerbl et al.). The color is the sum of w
// c; a ray has a surface where the sum of w is at least a half.
//
// The filters that rasterizers apply in the picture (0.3 pixels of variance, or the low-pass of
// discs) are those of one camera and are left out: what is thinner than a pixel looks thinner here.

#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "raylift/base/enum_names.h"

namespace raylift {

// The depth at which a ray has its surface.
enum class SplatDepth {
  kMedian,    // the first t behind which no more than half of the light is left (Huang et al.)
  kExpected,  // the mean of t by weight: smooth, but between surfaces where there are two
  kPeak,      // that of the largest weight
};
template <>
inline constexpr auto kEnumNames<SplatDepth> = std::to_array<EnumName<SplatDepth>>({
    {SplatDepth::kMedian, "median"},
    {SplatDepth::kExpected, "expected"},
    {SplatDepth::kPeak, "peak"},
});

// Gaussians more transparent than this are not seen.
inline constexpr double kLeastAlpha = 1.0 / 255;

struct Splats {
  // Means are float, relative to this origin.
  Eigen::Vector3d origin_in_world = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector3f> means;
  std::vector<Eigen::Quaternionf> rotations;  // unit; world_from_axes of each one
  std::vector<Eigen::Vector3f> scales;        // standard deviations along the axes
  std::vector<float> opacities;

  // These are the color's spherical harmonics by the direction from the eye to the mean: (degree +
  // 1)^2 coefficients of red, green and blue for each Gaussian, in the reference code's order.
  // There are none where there are no colors.
  int degree = 0;
  std::vector<Eigen::Vector3f> harmonics;
  // This rotates the world's directions into the harmonics' frame; it is a mirror where its
  // determinant is -1.
  Eigen::Matrix3d harmonics_from_world = Eigen::Matrix3d::Identity();

  std::vector<std::string> warnings;

  size_t NumCoefficients() const {
    return static_cast<size_t>(degree + 1) * static_cast<size_t>(degree + 1);
  }
  size_t MemoryBytes() const;
};

// Reads a PLY (binary) with x, y, z, opacity (its logit), scale_0 to scale_2 (logarithms; discs
// have two), rot_0 to rot_3 (w x y z, of any length), f_dc_0 to f_dc_2 and f_rest_* (degrees 1 to
// 3; all coefficients of red, then of green, then of blue), as the reference code, gsplat and
// nerfstudio write it; or red, green and blue in place of the harmonics. Compressed ones, as
// PlayCanvas' SuperSplat and splat-transform write them, have packed_position, packed_rotation,
// packed_scale and packed_color, and the element chunk with their ranges. Gaussians with a number
// that is not finite are left out and counted in `warnings`; those too transparent to be seen are
// left out without a warning. Throws InputError naming the file and field where it cannot be read
// or nothing is left.
Splats ReadSplats(const std::filesystem::path& path);

}  // namespace raylift
