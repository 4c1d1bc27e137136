#include "renderers/block_kernels.h"

#include <cmath>
#include <limits>

#include "base/instruction_sets.h"

namespace raylift {
namespace {

// The cosine of incidence below which the rounding of a direction in float moves a hit by more than
// about 5e-6 of its distance.
constexpr float kGrazingCosine = 0.02f;
// No origin is rounded by more than this share of the distance, but where the plane is grazed.
constexpr float kMaxShift = 1e-3f;

constexpr unsigned kInvalid = ~0u;  // RTC_INVALID_GEOMETRY_ID

template <size_t kSize>
[[gnu::always_inline]] inline size_t SetLanes(const float* __restrict x, const float* __restrict y,
                                              const float* __restrict z,
                                              const PacketDirections& packet,
                                              int* __restrict valid) {
  float* __restrict out_x = packet.x;
  float* __restrict out_y = packet.y;
  float* __restrict out_z = packet.z;
  int count = 0;
#pragma omp simd reduction(+ : count)
  for (size_t i = 0; i < kSize; ++i) {
    const float squared = x[i] * x[i] + y[i] * y[i] + z[i] * z[i];
    // A comparison with NaN is false.
    const int is_ray = (squared > 0 ? -1 : 0) & (squared < 3e38f ? -1 : 0);
    valid[i] = is_ray;
    count -= is_ray;
    out_x[i] = x[i];
    out_y[i] = y[i];
    out_z[i] = z[i];
  }
  float* __restrict tfar = packet.tfar;
  unsigned* __restrict geometry = packet.geometry;
  unsigned* __restrict instance = packet.instance;
#pragma omp simd
  for (size_t i = 0; i < kSize; ++i) {
    tfar[i] = std::numeric_limits<float>::infinity();
    geometry[i] = kInvalid;
    instance[i] = kInvalid;
  }
  return static_cast<size_t>(count);
}

template <size_t kSize>
[[gnu::always_inline]] inline HitSummary TakeLanes(const PacketHits& p,
                                                   const Eigen::Vector3f& offset,
                                                   const int* __restrict valid,
                                                   int* __restrict grazes, float* __restrict ray_t,
                                                   uint32_t* __restrict triangle) {
  const float ox = offset.x();
  const float oy = offset.y();
  const float oz = offset.z();
  int missed = 0;
  int any_grazing = 0;
  const float* __restrict px = p.x;
  const float* __restrict py = p.y;
  const float* __restrict pz = p.z;
  const float* __restrict tfar = p.tfar;
  const float* __restrict normal_x = p.normal_x;
  const float* __restrict normal_y = p.normal_y;
  const float* __restrict normal_z = p.normal_z;
  const unsigned* __restrict geometry = p.geometry;
  const unsigned* __restrict primitive = p.primitive;
#pragma omp simd reduction(+ : missed) reduction(| : any_grazing)
  for (size_t i = 0; i < kSize; ++i) {
    const float nx = normal_x[i];
    const float ny = normal_y[i];
    const float nz = normal_z[i];
    const float along = px[i] * nx + py[i] * ny + pz[i] * nz;
    const float t = tfar[i];
    const float shift = (ox * nx + oy * ny + oz * nz) / along;
    const float shifted = std::abs(shift) < kMaxShift * t ? t + shift : t;
    const int hit = valid[i] & (geometry[i] != kInvalid ? -1 : 0);
    const float squared_length = px[i] * px[i] + py[i] * py[i] + pz[i] * pz[i];
    const float steep =
        kGrazingCosine * kGrazingCosine * squared_length * (nx * nx + ny * ny + nz * nz);
    grazes[i] = hit & (along * along < steep ? -1 : 0);
    any_grazing |= grazes[i];
    missed -= valid[i] & ~hit;
    ray_t[i] = hit != 0 ? shifted : ray_t[i];
    triangle[i] = hit != 0 ? primitive[i] : triangle[i];
  }
  return {static_cast<size_t>(missed), any_grazing != 0};
}

}  // namespace

RAYLIFT_FOR_EACH_ISA
void RotateBlock(const Eigen::Matrix3f& rotation, const RayBlock& in, RayBlock& out) {
  const float* const r = rotation.data();  // by columns
  const float r0 = r[0], r1 = r[1], r2 = r[2], r3 = r[3], r4 = r[4];
  const float r5 = r[5], r6 = r[6], r7 = r[7], r8 = r[8];
  const float* const __restrict x = in.x.data();
  const float* const __restrict y = in.y.data();
  const float* const __restrict z = in.z.data();
  float* const __restrict out_x = out.x.data();
  float* const __restrict out_y = out.y.data();
  float* const __restrict out_z = out.z.data();
#pragma omp simd
  for (size_t i = 0; i < RayBlock::kSize; ++i) {
    out_x[i] = r0 * x[i] + r3 * y[i] + r6 * z[i];
    out_y[i] = r1 * x[i] + r4 * y[i] + r7 * z[i];
    out_z[i] = r2 * x[i] + r5 * y[i] + r8 * z[i];
  }
}

RAYLIFT_FOR_EACH_ISA
void RotateSlopes(const Eigen::Matrix3f& rotation, const PixelRays::Slopes& columns,
                  const PixelRays::Slopes& rows, RayBlock& out) {
  const float* const r = rotation.data();  // by columns
  const float r0 = r[0], r1 = r[1], r2 = r[2], r3 = r[3], r4 = r[4];
  const float r5 = r[5], r6 = r[6], r7 = r[7], r8 = r[8];
  const float* const __restrict u = columns.data();
  const float* const __restrict v = rows.data();
  float* const __restrict out_x = out.x.data();
  float* const __restrict out_y = out.y.data();
  float* const __restrict out_z = out.z.data();
#pragma omp simd
  for (size_t i = 0; i < RayBlock::kSize; ++i) {
    out_x[i] = r0 * u[i] + r3 * v[i] + r6;
    out_y[i] = r1 * u[i] + r4 * v[i] + r7;
    out_z[i] = r2 * u[i] + r5 * v[i] + r8;
  }
}

RAYLIFT_FOR_EACH_ISA
void DepthOfBlock(const HitBlock& hits, const RayBlock& rays_in_cam, float* out) {
  const float* const __restrict t = hits.ray_t.data();
  const float* const __restrict z = rays_in_cam.z.data();
  float* const __restrict depth = out;
#pragma omp simd
  for (size_t i = 0; i < RayBlock::kSize; ++i) {
    const float product = t[i] * z[i];
    depth[i] = product > 0 ? product : 0.0f;
  }
}

RAYLIFT_FOR_EACH_ISA
void DistanceOfBlock(const HitBlock& hits, const PixelRays::Slopes& columns,
                     const PixelRays::Slopes& rows, float* out) {
  const float* const __restrict t = hits.ray_t.data();
  const float* const __restrict u = columns.data();
  const float* const __restrict v = rows.data();
  float* const __restrict distance = out;
#pragma omp simd
  for (size_t i = 0; i < RayBlock::kSize; ++i) {
    distance[i] = t[i] * std::sqrt(u[i] * u[i] + v[i] * v[i] + 1);
  }
}

template <>
RAYLIFT_FOR_EACH_ISA size_t SetDirections<16>(const RayBlock& rays, size_t begin,
                                              const PacketDirections& packet, int* valid) {
  return SetLanes<16>(&rays.x[begin], &rays.y[begin], &rays.z[begin], packet, valid);
}

template <>
RAYLIFT_FOR_EACH_ISA size_t SetDirections<8>(const RayBlock& rays, size_t begin,
                                             const PacketDirections& packet, int* valid) {
  return SetLanes<8>(&rays.x[begin], &rays.y[begin], &rays.z[begin], packet, valid);
}

template <>
RAYLIFT_FOR_EACH_ISA HitSummary TakeHits<16>(const PacketHits& packet,
                                             const Eigen::Vector3f& offset, const int* valid,
                                             size_t begin, int* grazes, HitBlock& hits) {
  return TakeLanes<16>(packet, offset, valid, grazes, &hits.ray_t[begin], &hits.triangle[begin]);
}

template <>
RAYLIFT_FOR_EACH_ISA HitSummary TakeHits<8>(const PacketHits& packet, const Eigen::Vector3f& offset,
                                            const int* valid, size_t begin, int* grazes,
                                            HitBlock& hits) {
  return TakeLanes<8>(packet, offset, valid, grazes, &hits.ray_t[begin], &hits.triangle[begin]);
}

}  // namespace raylift
