// Blends the discs of a point cloud that a ray passes through into one surface.

#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include <Eigen/Core>

#include "raylift/surfaces/point_cloud.h"

namespace raylift {

// A ray in the surfels' local coordinates; the direction is unit.
struct DiscRay {
  Eigen::Vector3d origin;
  Eigen::Vector3d direction;
};

// Returns how far behind the first disc others may belong to the same surface, along the ray.
double BlendReach(const Surfels& surfels, const DiscRay& ray, uint32_t first);

struct BlendedHit {
  double t;
  double sigma;            // along the normal
  Eigen::Vector3d normal;  // unit, turned against the ray
  uint32_t nearest;        // the disc whose center is the closest to the ray
};
struct Blend {
  std::optional<BlendedHit> hit;
  double last_t;  // where the ray has passed through all discs of this surface
};

// Blends those of `discs`, which the ray meets within BlendReach, that belong to the first one's
// surface: their planes meet the ray where its does, within the scatter of both. Between their
// centers there is a surface: the mean of their planes, by their precision, so that a disc across a
// crease, whose points scatter, counts for little. Beyond their centers there is none: a surface
// ends where its points do, and not a radius further on. `rounding` is what float coordinates
// resolve.
Blend BlendDiscs(const Surfels& surfels, const DiscRay& ray, uint32_t first,
                 std::span<const uint32_t> discs, double rounding);

}  // namespace raylift
