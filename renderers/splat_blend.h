// Finds and blends the Gaussians that a ray meets, by the equations of splats.h.

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/surfaces/splats.h"

namespace raylift {

// A Gaussian for casting rays, in one line of the cache.
struct alignas(64) PackedSplat {
  std::array<float, 3> mean;
  // The matrix, row by row, that maps the world about the mean to where the Gaussian is round and
  // of size 1, so that S = whitening^T whitening.
  std::array<float, 9> whitening;
  float opacity;
  float reach2;       // the squared distance in sigmas at which alpha is kLeastAlpha
  uint32_t index;     // in the Splats
  uint32_t flattest;  // the row of its shortest axis

  // Returns half the sides of the box of all points with alpha >= kLeastAlpha; its center is the
  // mean.
  Eigen::Vector3f HalfBox() const;
};

// Returns the Gaussians in an order in which neighbors in space are close to each other.
std::vector<PackedSplat> PackSplats(const Splats& splats, int threads);

// A ray in the splats' local coordinates; the direction is unit.
struct SplatRay {
  Eigen::Vector3d origin;
  Eigen::Vector3d direction;
};

struct SplatOnRay {
  double t;
  double alpha;
  uint32_t splat;  // among the packed ones
};

// Returns what a Gaussian covers of a ray, at whatever t it is; nullopt if its alpha is below
// kLeastAlpha.
std::optional<SplatOnRay> MeetSplat(const PackedSplat& splat, uint32_t index, const SplatRay& ray);

// Sorts by t and drops those that light does not reach, all but the first. Returns the t from which
// on nothing counts; nullopt where light reaches all.
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

// Blends `met` as SortVisible() leaves it. `colors` is empty, or has one color per Gaussian of the
// Splats.
SplatBlend BlendSplats(std::span<const PackedSplat> splats, const SplatRay& ray,
                       std::span<const SplatOnRay> met, SplatDepth depth,
                       std::span<const Eigen::Vector3f> colors);

// Collects the Gaussians that a ray meets, while Embree finds them about from front to back: what
// light does not reach is dropped on the way, and the search ends there.
class SplatVisitor {
 public:
  explicit SplatVisitor(std::span<const PackedSplat> splats) : splats_(splats) {}

  // Begins a ray. Gaussians up to t_near are not there. Embree's ray starts at `shift`.
  void Start(const SplatRay& ray, double t_near, double shift) {
    ray_ = ray;
    t_near_ = t_near;
    shift_ = shift;
    met_.clear();
    limit_ = kFewest;
    end_ = std::numeric_limits<float>::infinity();
  }

  // Takes a Gaussian that Embree's ray may meet; returns where the ray ends from now on.
  float Visit(uint32_t index) {
    const auto met = MeetSplat(splats_[index], index, ray_);
    if (!met || !(met->t > t_near_)) return end_;
    met_.push_back(*met);
    if (met_.size() >= limit_) Prune();
    return end_;
  }

  // Returns all Gaussians that count, in the order that BlendSplats() takes.
  std::span<const SplatOnRay> Finish() {
    SortVisible(met_);
    return met_;
  }

 private:
  static constexpr size_t kFewest = 32;

  void Prune() {
    if (const auto last = SortVisible(met_)) {
      end_ = std::nextafter(static_cast<float>(*last - shift_),
                            std::numeric_limits<float>::infinity());
    }
    limit_ = std::max(kFewest, 2 * met_.size());
  }

  std::span<const PackedSplat> splats_;
  SplatRay ray_;
  double t_near_ = 0;
  double shift_ = 0;
  std::vector<SplatOnRay> met_;
  size_t limit_ = kFewest;  // so that sorting costs no more than what was added
  float end_ = 0;
};

// Returns the colors as seen from an eye: red, green and blue of at least 0, where 1 is full
// intensity.
std::vector<Eigen::Vector3f> SplatColors(const Splats& splats, const Eigen::Vector3d& eye_in_world,
                                         int threads);

}  // namespace raylift
