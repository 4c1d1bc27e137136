// What a ray meets of Gaussian splats, one by one and blended: the equations of splats.h.

#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/renderers/splats.h"

namespace raylift {

// What is more transparent than this is not there.
inline constexpr double kLeastAlpha = 1.0 / 255;

// A Gaussian as rays ask for it: in one line of the cache.
struct alignas(64) PackedSplat {
  std::array<float, 3> mean;
  // Row by row: from the world about the mean to where the Gaussian is round and of size 1, so that
  // S = whitening^T whitening.
  std::array<float, 9> whitening;
  float opacity;
  float reach2;       // the squared distance in sigmas at which alpha is kLeastAlpha
  uint32_t index;     // in the Splats
  uint32_t flattest;  // the row of its shortest axis

  // The box of all points with alpha >= kLeastAlpha: its center is the mean.
  Eigen::Vector3f HalfBox() const;
};

// In an order in which neighbors in space are close to each other.
std::vector<PackedSplat> PackSplats(const Splats& splats, int threads);

// In the splats' local coordinates; the direction is unit.
struct SplatRay {
  Eigen::Vector3d origin;
  Eigen::Vector3d direction;
};

struct SplatOnRay {
  double t;
  double alpha;
  uint32_t splat;  // among the packed ones
};

// None where alpha < kLeastAlpha. Any t.
std::optional<SplatOnRay> MeetSplat(const PackedSplat& splat, uint32_t place, const SplatRay& ray);

// Sorts by t and drops those that light does not reach. Where there are such: the t from which on
// nothing counts.
std::optional<double> SortVisible(std::vector<SplatOnRay>& met);

struct SplatBlend {
  struct Surface {
    double t;
    double sigma_along_ray;  // of the light's t, with each Gaussian's own spread
    Eigen::Vector3d normal;  // unit, turned against the ray
    uint32_t heaviest;       // index in the Splats of the one of the largest weight
  };
  std::optional<Surface> surface;
  Eigen::Vector3f color = Eigen::Vector3f::Zero();
  double transmittance = 1;  // what is left behind all of them
};

// `met` as SortVisible leaves it. `colors` is empty, or one per Gaussian of the Splats.
SplatBlend BlendSplats(std::span<const PackedSplat> splats, const SplatRay& ray,
                       std::span<const SplatOnRay> met, SplatDepth depth,
                       std::span<const Eigen::Vector3f> colors);

}  // namespace raylift
