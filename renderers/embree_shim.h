// Embree 3 (from 3.12 on) and 4 behind one interface: handles that release themselves, and the
// calls whose signatures differ between the two.

#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <type_traits>
#include <vector>

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

// kCoherent: the rays of a call run close together. Saying so of rays that do not halves the speed.
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

// Sets the fields that all packets from one point share; sets every field, as Embree reads them
// all.
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

// Takes down every primitive that a ray meets, instead of the first one.
class GatherState {
 public:
#if RAYLIFT_EMBREE_MAJOR >= 4
  GatherState() {
    rtcInitRayQueryContext(&query_.context);
    rtcInitIntersectArguments(&arguments_);
    arguments_.context = &query_.context;
    arguments_.filter = &GatherState::OnHit;
    arguments_.flags = static_cast<RTCRayQueryFlags>(RTC_RAY_QUERY_FLAG_INCOHERENT |
                                                     RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER);
  }
#else
  GatherState() {
    rtcInitIntersectContext(&query_.context);
    query_.context.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    query_.context.filter = &GatherState::OnHit;
  }
#endif
  GatherState(const GatherState&) = delete;  // arguments point to the query
  GatherState& operator=(const GatherState&) = delete;

  // Prepares a scene; to be called before it is committed.
  static void Allow(RTCScene scene, [[maybe_unused]] RTCGeometry geometry) {
#if RAYLIFT_EMBREE_MAJOR >= 4
    constexpr RTCSceneFlags kFlag = RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS;
    rtcSetGeometryEnableFilterFunctionFromArguments(geometry, true);
#else
    constexpr RTCSceneFlags kFlag = RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION;
#endif
    rtcSetSceneFlags(scene, static_cast<RTCSceneFlags>(rtcGetSceneFlags(scene) | kFlag));
  }

  // The primitives that a ray meets between t_near and t_far, in no order; valid until the next.
  std::vector<uint32_t>& Gather(RTCScene scene, const float* origin, const float* direction,
                                float t_near, float t_far) {
    query_.primitives.clear();
    RTCRayHit ray_hit = MakeRayHit(origin, direction, t_near);
    ray_hit.ray.tfar = t_far;
#if RAYLIFT_EMBREE_MAJOR >= 4
    rtcIntersect1(scene, &ray_hit, &arguments_);
#else
    rtcIntersect1(scene, &query_.context, &ray_hit);
#endif
    return query_.primitives;
  }

 private:
#if RAYLIFT_EMBREE_MAJOR >= 4
  using Context = RTCRayQueryContext;
  RTCIntersectArguments arguments_;
#else
  using Context = RTCIntersectContext;
#endif
  struct Query {
    Context context;
    std::vector<uint32_t> primitives;
  };

  static void OnHit(const RTCFilterFunctionNArguments* arguments) {
    auto* const query = reinterpret_cast<Query*>(arguments->context);
    query->primitives.push_back(RTCHitN_primID(arguments->hit, arguments->N, 0));
    arguments->valid[0] = 0;  // go on
  }

  Query query_;
};

// Shows a visitor every primitive of user geometry whose box a ray meets, about from front to back.
// `float Visitor::Visit(uint32_t primitive)` returns where the ray ends from then on.
template <typename Visitor>
class VisitState {
 public:
#if RAYLIFT_EMBREE_MAJOR >= 4
  explicit VisitState(Visitor& visitor) : query_{{}, &visitor} {
    rtcInitRayQueryContext(&query_.context);
    rtcInitIntersectArguments(&arguments_);
    arguments_.context = &query_.context;
    arguments_.flags = RTC_RAY_QUERY_FLAG_INCOHERENT;
  }
#else
  explicit VisitState(Visitor& visitor) : query_{{}, &visitor} {
    rtcInitIntersectContext(&query_.context);
    query_.context.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  }
#endif
  VisitState(const VisitState&) = delete;  // arguments point to the query
  VisitState& operator=(const VisitState&) = delete;

  // Prepares user geometry; to be called before it is committed.
  static void Allow(RTCGeometry geometry) {
    rtcSetGeometryIntersectFunction(geometry, &VisitState::OnBox);
  }

  void Visit(RTCScene scene, const float* origin, const float* direction, float t_near) {
    RTCRayHit ray_hit = MakeRayHit(origin, direction, t_near);
#if RAYLIFT_EMBREE_MAJOR >= 4
    rtcIntersect1(scene, &ray_hit, &arguments_);
#else
    rtcIntersect1(scene, &query_.context, &ray_hit);
#endif
  }

 private:
#if RAYLIFT_EMBREE_MAJOR >= 4
  using Context = RTCRayQueryContext;
  RTCIntersectArguments arguments_;
#else
  using Context = RTCIntersectContext;
#endif
  struct Query {
    Context context;
    Visitor* visitor;
  };

  static void OnBox(const RTCIntersectFunctionNArguments* arguments) {
    if (arguments->valid[0] == 0) return;
    const Query* const query = reinterpret_cast<const Query*>(arguments->context);
    float& end = RTCRayN_tfar(RTCRayHitN_RayN(arguments->rayhit, arguments->N), arguments->N, 0);
    end = std::min(end, query->visitor->Visit(arguments->primID));
  }

  Query query_;
};

}  // namespace raylift::embree
