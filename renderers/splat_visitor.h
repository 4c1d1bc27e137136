// Collects the Gaussians that a ray meets, while Embree finds them about from front to back: what
// light does not reach is dropped on the way, and the search ends there.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "splat_blend.h"

namespace raylift {

class SplatVisitor {
 public:
  explicit SplatVisitor(std::span<const PackedSplat> splats) : splats_(splats) {}

  // Gaussians up to t_near are not there. Embree's ray starts at `shift`.
  void Start(const SplatRay& ray, double t_near, double shift) {
    ray_ = ray;
    t_near_ = t_near;
    shift_ = shift;
    met_.clear();
    limit_ = kFewest;
    end_ = std::numeric_limits<float>::infinity();
  }

  // Embree's ray may meet this one; returns where the ray ends from now on.
  float Visit(uint32_t place) {
    const auto met = MeetSplat(splats_[place], place, ray_);
    if (!met || !(met->t > t_near_)) return end_;
    met_.push_back(*met);
    if (met_.size() >= limit_) Prune();
    return end_;
  }

  // All that count, in order, as BlendSplats takes them.
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

}  // namespace raylift
