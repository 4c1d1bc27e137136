// Kernels on the packets of rays, 16 (or 8) lanes at once: plain loops that are compiled for
// several instruction sets, of which the machine's best runs. All give the same bits.

#pragma once

#include <cstddef>

#include <Eigen/Core>

#include "raylift/renderers/pixel_rays.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {

// Computes out = rotation * in for every ray.
void RotateBlock(const Eigen::Matrix3f& rotation, const RayBlock& in, RayBlock& out);

// Computes out = rotation * (x slope, y slope, 1) for the rays of a pinhole.
void RotateSlopes(const Eigen::Matrix3f& rotation, const PixelRays::Slopes& columns,
                  const PixelRays::Slopes& rows, RayBlock& out);

// Computes out[i] = max(0, ray_t[i] * z[i]) for the 16 rays of a block.
void DepthOfBlock(const HitBlock& hits, const RayBlock& rays_in_cam, float* out);

// Computes the distance of each lane's hit:
//   out[i] = ray_t[i] * the length of (x slope, y slope, 1)
void DistanceOfBlock(const HitBlock& hits, const PixelRays::Slopes& columns,
                     const PixelRays::Slopes& rows, float* out);

// Fields of a packet of Embree's, lanes in a row; all have kSize lanes.
struct PacketDirections {
  float* x;
  float* y;
  float* z;
  float* tfar;
  unsigned* geometry;
  unsigned* instance;
};

// Sets directions that have not hit anything; valid[i] is 0 where a direction has no length (or is
// not finite), else -1. Returns how many are valid.
template <size_t kSize>
size_t SetDirections(const RayBlock& rays, size_t begin, const PacketDirections& packet,
                     int* valid);

struct PacketHits {
  const float* x;  // the direction
  const float* y;
  const float* z;
  const float* tfar;
  const float* normal_x;
  const float* normal_y;
  const float* normal_z;
  const unsigned* geometry;
  const unsigned* primitive;
};

struct HitSummary {
  size_t missed;  // of the valid lanes
  bool any_grazing;
};

// Moves hits to lanes `begin`... of `hits`, with the rounding of the packet's origin taken back: it
// moves a hit by offset . n / direction . n. grazes[i] is -1 where that lane grazes its triangle.
template <size_t kSize>
HitSummary TakeHits(const PacketHits& packet, const Eigen::Vector3f& offset, const int* valid,
                    size_t begin, int* grazes, HitBlock& hits);

}  // namespace raylift
