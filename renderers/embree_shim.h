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

// With kCoherent the rays of a call run close together. Saying so of rays that do not halves the
// speed.
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

#if RAYLIFT_EMBREE_MAJOR >= 4
using QueryContext = RTCRayQueryContext;
using QueryFlags = RTCRayQueryFlags;
constexpr QueryFlags kIncoherent = RTC_RAY_QUERY_FLAG_INCOHERENT;
#else
using QueryContext = RTCIntersectContext;
using QueryFlags = RTCIntersectContextFlags;
constexpr QueryFlags kIncoherent = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
#endif

// A query of single rays whose callbacks have access to `data`.
template <typename Data>
class Query {
 public:
  explicit Query(Data data, RTCFilterFunctionN filter = nullptr) : shared_{{}, data} {
#if RAYLIFT_EMBREE_MAJOR >= 4
    rtcInitRayQueryContext(&shared_.context);
    rtcInitIntersectArguments(&arguments_);
    arguments_.context = &shared_.context;
    arguments_.filter = filter;
    arguments_.flags =
        filter == nullptr
            ? kIncoherent
            : static_cast<QueryFlags>(kIncoherent | RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER);
#else
    rtcInitIntersectContext(&shared_.context);
    shared_.context.flags = kIncoherent;
    shared_.context.filter = filter;
#endif
  }
  Query(const Query&) = delete;  // arguments point to what is shared
  Query& operator=(const Query&) = delete;

  void Intersect(RTCScene scene, RTCRayHit& ray_hit) {
#if RAYLIFT_EMBREE_MAJOR >= 4
    rtcIntersect1(scene, &ray_hit, &arguments_);
#else
    rtcIntersect1(scene, &shared_.context, &ray_hit);
#endif
  }

  Data& data() { return shared_.data; }
  // Returns the data for callbacks, from Embree's context.
  static Data& DataOf(QueryContext* context) { return reinterpret_cast<Shared*>(context)->data; }

 private:
  struct Shared {
    QueryContext context;
    Data data;
  };
  Shared shared_;
#if RAYLIFT_EMBREE_MAJOR >= 4
  RTCIntersectArguments arguments_;
#endif
};

// Takes down every primitive that a ray meets, instead of the first one.
class GatherState {
 public:
  GatherState() : query_({}, &GatherState::OnHit) {}

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

  // Returns the primitives that a ray meets between t_near and t_far, in no order; valid until the
  // next call.
  std::vector<uint32_t>& Gather(RTCScene scene, const float* origin, const float* direction,
                                float t_near, float t_far) {
    query_.data().clear();
    RTCRayHit ray_hit = MakeRayHit(origin, direction, t_near);
    ray_hit.ray.tfar = t_far;
    query_.Intersect(scene, ray_hit);
    return query_.data();
  }

 private:
  using Primitives = std::vector<uint32_t>;

  static void OnHit(const RTCFilterFunctionNArguments* arguments) {
    Query<Primitives>::DataOf(arguments->context)
        .push_back(RTCHitN_primID(arguments->hit, arguments->N, 0));
    arguments->valid[0] = 0;  // go on
  }

  Query<Primitives> query_;
};

// Shows a visitor every primitive of user geometry whose box a ray meets, about from front to back.
// `float Visitor::Visit(uint32_t primitive)` returns where the ray ends from then on.
template <typename Visitor>
class VisitState {
 public:
  explicit VisitState(Visitor& visitor) : query_(&visitor) {}

  // Prepares user geometry; to be called before it is committed.
  static void Allow(RTCGeometry geometry) {
    rtcSetGeometryIntersectFunction(geometry, &VisitState::OnBox);
  }

  void Visit(RTCScene scene, const float* origin, const float* direction, float t_near) {
    RTCRayHit ray_hit = MakeRayHit(origin, direction, t_near);
    query_.Intersect(scene, ray_hit);
  }

 private:
  static void OnBox(const RTCIntersectFunctionNArguments* arguments) {
    if (arguments->valid[0] == 0) return;
    float& end = RTCRayN_tfar(RTCRayHitN_RayN(arguments->rayhit, arguments->N), arguments->N, 0);
    end = std::min(end, Query<Visitor*>::DataOf(arguments->context)->Visit(arguments->primID));
  }

  Query<Visitor*> query_;
};

}  // namespace raylift::embree
