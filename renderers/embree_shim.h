// Embree 3 (from 3.12 on) and 4 behind one interface: handles that release themselves, and the
// calls whose signatures differ between the two.

#pragma once

#include <cstddef>
#include <limits>
#include <memory>
#include <type_traits>

#if RAYLIFT_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

namespace raylift::embree {

struct ReleaseDevice {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
};
struct ReleaseScene {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};
struct ReleaseGeometry {
  void operator()(RTCGeometry geometry) const { rtcReleaseGeometry(geometry); }
};
using Device = std::unique_ptr<std::remove_pointer_t<RTCDevice>, ReleaseDevice>;
using Scene = std::unique_ptr<std::remove_pointer_t<RTCScene>, ReleaseScene>;
using Geometry = std::unique_ptr<std::remove_pointer_t<RTCGeometry>, ReleaseGeometry>;

// Whether the rays of a call run close together. Saying so for rays that do not halves the speed.
enum class Coherence { kIncoherent, kCoherent };

#if RAYLIFT_EMBREE_MAJOR >= 4

class IntersectState {
 public:
  explicit IntersectState(Coherence coherence) {
    rtcInitIntersectArguments(&intersect_);
    rtcInitOccludedArguments(&occluded_);
    intersect_.flags = occluded_.flags = coherence == Coherence::kCoherent
                                             ? RTC_RAY_QUERY_FLAG_COHERENT
                                             : RTC_RAY_QUERY_FLAG_INCOHERENT;
  }
  void Intersect1(RTCScene scene, RTCRayHit* ray) { rtcIntersect1(scene, ray, &intersect_); }
  void Intersect8(const int* valid, RTCScene scene, RTCRayHit8* rays) {
    rtcIntersect8(valid, scene, rays, &intersect_);
  }
  void Intersect16(const int* valid, RTCScene scene, RTCRayHit16* rays) {
    rtcIntersect16(valid, scene, rays, &intersect_);
  }
  void Occluded1(RTCScene scene, RTCRay* ray) { rtcOccluded1(scene, ray, &occluded_); }

 private:
  RTCIntersectArguments intersect_;
  RTCOccludedArguments occluded_;
};

#else

class IntersectState {
 public:
  explicit IntersectState(Coherence coherence) {
    rtcInitIntersectContext(&context_);
    context_.flags = coherence == Coherence::kCoherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT
                                                       : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  }
  void Intersect1(RTCScene scene, RTCRayHit* ray) { rtcIntersect1(scene, &context_, ray); }
  void Intersect8(const int* valid, RTCScene scene, RTCRayHit8* rays) {
    rtcIntersect8(valid, scene, &context_, rays);
  }
  void Intersect16(const int* valid, RTCScene scene, RTCRayHit16* rays) {
    rtcIntersect16(valid, scene, &context_, rays);
  }
  void Occluded1(RTCScene scene, RTCRay* ray) { rtcOccluded1(scene, &context_, ray); }

 private:
  RTCIntersectContext context_;
};

#endif

template <typename RayHitN>
inline constexpr size_t kPacketSize = sizeof(RayHitN::ray.tfar) / sizeof(float);

// What stays the same for all packets from one point; every field is set, as Embree reads them all.
template <typename RayHitN>
void SetConstants(RayHitN& packet, const float* origin) {
  for (size_t i = 0; i < kPacketSize<RayHitN>; ++i) {
    packet.ray.org_x[i] = origin[0];
    packet.ray.org_y[i] = origin[1];
    packet.ray.org_z[i] = origin[2];
    packet.ray.tnear[i] = 0;
    packet.ray.time[i] = 0;
    packet.ray.mask[i] = 0xffffffffu;
    packet.ray.id[i] = 0;
    packet.ray.flags[i] = 0;
    packet.hit.primID[i] = RTC_INVALID_GEOMETRY_ID;
    packet.hit.Ng_x[i] = packet.hit.Ng_y[i] = packet.hit.Ng_z[i] = 0;
#if defined(RTC_GEOMETRY_INSTANCE_ARRAY)  // from Embree 4.3 on
    packet.hit.instPrimID[0][i] = RTC_INVALID_GEOMETRY_ID;
#endif
  }
}

inline RTCRay MakeRay(const float* origin, const float* direction, float t_near) {
  RTCRay ray;
  ray.org_x = origin[0];
  ray.org_y = origin[1];
  ray.org_z = origin[2];
  ray.tnear = t_near;
  ray.dir_x = direction[0];
  ray.dir_y = direction[1];
  ray.dir_z = direction[2];
  ray.time = 0;
  ray.tfar = std::numeric_limits<float>::infinity();
  ray.mask = 0xffffffffu;
  ray.id = 0;
  ray.flags = 0;
  return ray;
}

inline RTCRayHit MakeRayHit(const float* origin, const float* direction, float t_near) {
  RTCRayHit ray_hit{};
  ray_hit.ray = MakeRay(origin, direction, t_near);
  ray_hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  ray_hit.hit.primID = RTC_INVALID_GEOMETRY_ID;
  ray_hit.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
#if defined(RTC_GEOMETRY_INSTANCE_ARRAY)
  ray_hit.hit.instPrimID[0] = RTC_INVALID_GEOMETRY_ID;
#endif
  return ray_hit;
}

}  // namespace raylift::embree
