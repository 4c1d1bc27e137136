#include "raylift/renderers/ray_caster.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <mutex>
#include <new>
#include <stdexcept>

#include "renderers/block_kernels.h"
#include "renderers/disc_blend.h"
#include "renderers/embree_shim.h"
#include "renderers/splat_blend.h"
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr size_t kBatch = 64;

// Where a hit in float and its refinement in double are further apart than these shares of the
// ray's length and of the scene's size, the ray grazes the triangle's plane, and the float's is the
// better one.
constexpr double kMaxRefinementOfRay = 1e-3;
constexpr double kMaxRefinementOfScene = 4e-6;

// Embree's robust test lets no ray through an edge, but a few in a thousand of those that aim at a
// vertex itself slip between its triangles, as their edge functions are rounded one by one. A ray
// that hits nothing is therefore tried once more, turned by this angle, which is what float rounds.
constexpr float kNudge = 0x1p-21f;

// From further away than this many radii of the scene, blocks are cast ray by ray, each started
// near the mesh: float would round the camera's place too coarsely.
constexpr double kMaxBlockDistance = 100;

Eigen::Vector3f Nudged(const Eigen::Vector3f& direction) {
  return direction + kNudge * direction.norm() * direction.unitOrthogonal();
}

// A ray as Embree gets it: float, relative to the mesh's origin, of unit length, and started near
// the mesh where the camera is far away, since float would lose its position there.
struct LocalRay {
  Eigen::Vector3d origin;     // before the shift
  Eigen::Vector3d direction;  // unit
  double shift;               // Embree's ray starts here
  Eigen::Vector3f float_origin;
  Eigen::Vector3f float_direction;
};

struct Bounds {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double radius = 0;
};

Bounds BoundsOf(const Eigen::AlignedBox3f& box) {
  const Eigen::Vector3d low = box.min().cast<double>();
  const Eigen::Vector3d high = box.max().cast<double>();
  return {0.5 * (low + high), 0.5 * (high - low).norm()};
}

Bounds BoundsOf(const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) {
    return {};
  }
  Eigen::AlignedBox3f box;
  for (const auto& triangle : mesh.triangles) {
    for (const uint32_t index : triangle) box.extend(mesh.vertices[index]);
  }
  return BoundsOf(box);
}

Bounds BoundsOf(const Surfels& surfels) {
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector4f& disc : surfels.discs) {
    box.extend((disc.head<3>().array() - disc.w()).matrix());
    box.extend((disc.head<3>().array() + disc.w()).matrix());
  }
  return BoundsOf(box);
}

Eigen::AlignedBox3f BoxOf(const PackedSplat& splat) {
  const Eigen::Vector3f mean(splat.mean.data());
  const Eigen::Vector3f half = splat.HalfBox();
  return {mean - half, mean + half};
}

Bounds BoundsOf(const std::vector<PackedSplat>& splats) {
  Eigen::AlignedBox3f box;
  for (const PackedSplat& splat : splats) box.extend(BoxOf(splat));
  return BoundsOf(box);
}

// Rays at surfels and splats take their origin from an empty mesh.
std::shared_ptr<const TriangleMesh> EmptyMeshAt(const Eigen::Vector3d& origin_in_world) {
  auto mesh = std::make_shared<TriangleMesh>();
  mesh->origin_in_world = origin_in_world;
  return mesh;
}

void CheckIndices(const TriangleMesh& mesh) {
  for (const auto& triangle : mesh.triangles) {
    RAYLIFT_CHECK(std::max({triangle[0], triangle[1], triangle[2]}) < mesh.vertices.size());
  }
}

}  // namespace

struct RayCaster::Impl {
  Impl(std::shared_ptr<const TriangleMesh> mesh_in, std::shared_ptr<const Surfels> surfels_in,
       std::shared_ptr<const Splats> splats_in, SplatDepth splat_depth_in,
       const RayCasterOptions& options)
      : mesh(std::move(mesh_in)),
        surfels(std::move(surfels_in)),
        splats(std::move(splats_in)),
        splat_depth(splat_depth_in) {
    if (splats != nullptr) packed_splats = PackSplats(*splats, /*threads=*/0);
    bounds = splats != nullptr    ? BoundsOf(packed_splats)
             : surfels != nullptr ? BoundsOf(*surfels)
                                  : BoundsOf(*mesh);
    reach = bounds.center.norm() + bounds.radius;
    device.reset(rtcNewDevice(nullptr));
    if (!device) {
      ThrowError({rtcGetDeviceError(nullptr), "no device"});
    }
    rtcSetDeviceErrorFunction(device.get(), &Impl::OnError, &first_error);
    rtcSetDeviceMemoryMonitorFunction(device.get(), &Impl::OnMemory, &memory_bytes);
    has_packets16 = rtcGetDeviceProperty(device.get(), RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED);
    has_packets8 = rtcGetDeviceProperty(device.get(), RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED);
    BuildScene(options);
    ThrowOnError();
    // Later errors would come from many threads; a valid scene has none.
    rtcSetDeviceErrorFunction(device.get(), nullptr, nullptr);
  }

  struct Error {
    RTCError code = RTC_ERROR_NONE;
    std::string message;
  };
  // The first of them counts.
  static void OnError(void* error, RTCError code, const char* message) {
    auto& stored = *static_cast<Error*>(error);
    if (stored.code != RTC_ERROR_NONE) return;
    stored.code = code;
    stored.message = message != nullptr ? message : "no text";
  }
  // What Embree takes is checked before. Of what it calls an unknown error it gives the text: of
  // TBB, which could not start a thread.
  [[noreturn]] static void ThrowError(const Error& error) {
    if (error.code == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
    const std::string text =
        fmt::format("Embree: error {}: {}", static_cast<int>(error.code), error.message);
    if (error.code == RTC_ERROR_UNKNOWN) throw ResourceError(text);
    throw std::runtime_error(text);
  }

  static bool OnMemory(void* counter, ssize_t bytes, bool) {
    *static_cast<std::atomic<int64_t>*>(counter) += bytes;
    return true;
  }

  // Embree's threads report at will, and not always in order.
  struct BuildProgress {
    const std::function<void(double)>& report;
    std::mutex mutex;
    double reported;

    static bool OnProgress(void* progress, double share) {
      auto& self = *static_cast<BuildProgress*>(progress);
      const std::lock_guard<std::mutex> lock(self.mutex);
      if (share > self.reported) {
        self.reported = share;
        self.report(std::min(share, 1.0));
      }
      return true;
    }
  };

  void ThrowOnError() const {
    if (first_error.code != RTC_ERROR_NONE) ThrowError(first_error);
  }

  void BuildScene(const RayCasterOptions& options) {
    const RTCBuildQuality quality = options.build_quality == RayCasterOptions::BuildQuality::kLow
                                        ? RTC_BUILD_QUALITY_LOW
                                        : RTC_BUILD_QUALITY_MEDIUM;
    scene.reset(rtcNewScene(device.get()));
    rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(scene.get(), quality);
    if (!mesh->triangles.empty()) AttachMesh(quality);
    if (surfels != nullptr) AttachSurfels(quality);
    if (splats != nullptr) AttachSplats(quality);
    BuildProgress progress{options.on_build_progress, {}, 0};
    if (options.on_build_progress) {
      rtcSetSceneProgressMonitorFunction(scene.get(), &BuildProgress::OnProgress, &progress);
    }
    rtcCommitScene(scene.get());
    rtcSetSceneProgressMonitorFunction(scene.get(), nullptr, nullptr);
  }

  // Embree reads 16 bytes at each vector of 12.
  const std::vector<Eigen::Vector3f>& Padded(const std::vector<Eigen::Vector3f>& vectors) {
    if (vectors.capacity() > vectors.size()) return vectors;
    padded_vectors.reserve(vectors.size() + 1);
    padded_vectors = vectors;
    return padded_vectors;
  }

  void AttachMesh(RTCBuildQuality quality) {
    const embree::Geometry geometry(rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
    const std::vector<Eigen::Vector3f>& vertices = Padded(mesh->vertices);
    rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                               vertices.data(), 0, sizeof(Eigen::Vector3f), vertices.size());
    rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                               mesh->triangles.data(), 0, 3 * sizeof(uint32_t),
                               mesh->triangles.size());
    rtcSetGeometryBuildQuality(geometry.get(), quality);
    rtcCommitGeometry(geometry.get());
    rtcAttachGeometry(scene.get(), geometry.get());
  }

  void AttachSurfels(RTCBuildQuality quality) {
    const embree::Geometry geometry(
        rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_ORIENTED_DISC_POINT));
    rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4,
                               surfels->discs.data(), 0, sizeof(Eigen::Vector4f),
                               surfels->discs.size());
    const std::vector<Eigen::Vector3f>& normals = Padded(surfels->normals);
    rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_NORMAL, 0, RTC_FORMAT_FLOAT3,
                               normals.data(), 0, sizeof(Eigen::Vector3f), normals.size());
    embree::GatherState::Allow(scene.get(), geometry.get());
    rtcSetGeometryBuildQuality(geometry.get(), quality);
    rtcCommitGeometry(geometry.get());
    rtcAttachGeometry(scene.get(), geometry.get());
  }

  void AttachSplats(RTCBuildQuality quality) {
    const embree::Geometry geometry(rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_USER));
    rtcSetGeometryUserPrimitiveCount(geometry.get(), static_cast<unsigned>(packed_splats.size()));
    rtcSetGeometryUserData(geometry.get(), this);
    rtcSetGeometryBoundsFunction(geometry.get(), &Impl::OnSplatBounds, nullptr);
    embree::VisitState<SplatVisitor>::Allow(geometry.get());
    rtcSetGeometryBuildQuality(geometry.get(), quality);
    rtcCommitGeometry(geometry.get());
    rtcAttachGeometry(scene.get(), geometry.get());
  }

  static void OnSplatBounds(const RTCBoundsFunctionArguments* arguments) {
    const auto& self = *static_cast<const Impl*>(arguments->geometryUserPtr);
    const Eigen::AlignedBox3f box = BoxOf(self.packed_splats[arguments->primID]);
    const auto rounding = static_cast<float>(kMaxRefinementOfScene * self.reach);
    RTCBounds& bounds = *arguments->bounds_o;
    bounds.lower_x = box.min().x() - rounding;
    bounds.lower_y = box.min().y() - rounding;
    bounds.lower_z = box.min().z() - rounding;
    bounds.upper_x = box.max().x() + rounding;
    bounds.upper_y = box.max().y() + rounding;
    bounds.upper_z = box.max().z() + rounding;
  }

  // None where a number is not finite or the direction has no length.
  std::optional<LocalRay> MakeLocalRay(const Eigen::Vector3d& origin_in_world,
                                       const Eigen::Vector3d& direction, double length) const {
    LocalRay ray;
    ray.origin = origin_in_world - mesh->origin_in_world;
    ray.direction = direction / length;
    const double nearest = (bounds.center - ray.origin).dot(ray.direction);
    ray.shift = std::max(0.0, nearest - 2 * bounds.radius);
    ray.float_origin = (ray.origin + ray.shift * ray.direction).cast<float>();
    ray.float_direction = ray.direction.cast<float>();
    if (!ray.float_origin.allFinite() || !ray.float_direction.allFinite()) {
      return std::nullopt;
    }
    return ray;
  }

  // What rays that are cast one by one, and blend what they meet, take along.
  struct BlendState {
    explicit BlendState(const Impl& impl) : visitor(impl.packed_splats) {}

    embree::IntersectState intersect{embree::Coherence::kIncoherent};
    embree::GatherState gather;
    SplatVisitor visitor;
    embree::VisitState<SplatVisitor> visit{visitor};
  };
  bool IsBlended() const { return surfels != nullptr || splats != nullptr; }

  std::optional<RayHit> CastBlended(const Ray& ray, BlendState& state) const {
    return splats != nullptr ? Look(ray, {}, state).hit : CastAtDiscs(ray, state);
  }

  SplatLook Look(const Ray& world_ray, std::span<const Eigen::Vector3f> colors_rgb,
                 BlendState& state) const {
    const double length = world_ray.direction_in_world.norm();
    const auto local =
        MakeLocalRay(world_ray.origin_in_world, world_ray.direction_in_world, length);
    if (!local) return {};
    const SplatRay ray{local->origin, local->direction};
    state.visitor.Start(ray, world_ray.ray_t_near * length, local->shift);
    state.visit.Visit(scene.get(), local->float_origin.data(), local->float_direction.data(),
                      FloatNear(*local, length, world_ray.ray_t_near));
    const SplatBlend blend =
        BlendSplats(packed_splats, ray, state.visitor.Finish(), splat_depth, colors_rgb);
    SplatLook look{std::nullopt, blend.color, blend.transmittance};
    if (const auto& surface = blend.surface) {
      const double along = std::abs(surface->normal.dot(ray.direction));
      look.hit = RayHit{surface->t / length, surface->normal, surface->heaviest,
                        Eigen::Vector2d::Zero(), surface->sigma_along_ray * along};
    }
    return look;
  }

  // The first surface that discs make on the ray.
  std::optional<RayHit> CastAtDiscs(const Ray& world_ray, BlendState& state) const {
    const double length = world_ray.direction_in_world.norm();
    const auto local =
        MakeLocalRay(world_ray.origin_in_world, world_ray.direction_in_world, length);
    if (!local) return std::nullopt;
    const LocalRay& ray = *local;
    float near = FloatNear(ray, length, world_ray.ray_t_near);
    const DiscRay disc_ray{ray.origin, ray.direction};
    const double rounding = kMaxRefinementOfScene * reach;
    while (const auto first = CastOne(ray, near, state.intersect)) {
      const float begin = std::max(near, first->t - static_cast<float>(rounding));
      const double end = double{first->t} + BlendReach(*surfels, disc_ray, first->triangle);
      std::vector<uint32_t>& discs =
          state.gather.Gather(scene.get(), ray.float_origin.data(), ray.float_direction.data(),
                              begin, static_cast<float>(end));
      std::sort(discs.begin(), discs.end());  // sums do not depend on the tree
      const Blend blend = BlendDiscs(*surfels, disc_ray, first->triangle, discs, rounding);
      if (blend.hit) {
        return RayHit{blend.hit->t / length, blend.hit->normal, blend.hit->nearest,
                      Eigen::Vector2d::Zero(), blend.hit->sigma};
      }
      near = std::nextafter(std::max(first->t, static_cast<float>(blend.last_t - ray.shift)),
                            std::numeric_limits<float>::infinity());
    }
    return std::nullopt;
  }

  // The hit with the triangle's plane, in double. `length` is that of the caller's direction.
  RayHit Refine(const LocalRay& ray, double length, uint32_t triangle, double coarse_t) const {
    const auto& [i0, i1, i2] = mesh->triangles[triangle];
    const Eigen::Vector3d v0 = mesh->vertices[i0].cast<double>();
    const Eigen::Vector3d e1 = mesh->vertices[i1].cast<double>() - v0;
    const Eigen::Vector3d e2 = mesh->vertices[i2].cast<double>() - v0;
    const Eigen::Vector3d normal = e1.cross(e2);
    double t = (v0 - ray.origin).dot(normal) / ray.direction.dot(normal);
    if (!(std::abs(t - coarse_t) <=
          kMaxRefinementOfRay * std::abs(coarse_t) + kMaxRefinementOfScene * reach)) {
      t = coarse_t;
    }
    const Eigen::Vector3d offset = ray.origin + t * ray.direction - v0;
    const double scale = 1 / normal.squaredNorm();
    const double u = std::clamp(offset.cross(e2).dot(normal) * scale, 0.0, 1.0);
    const double v = std::clamp(e1.cross(offset).dot(normal) * scale, 0.0, 1.0 - u);
    return {t / length, normal.normalized(), triangle, {u, v}};
  }

  // Where the rays of a block start: in float, and by how much that is off.
  struct BlockOrigin {
    Eigen::Vector3d origin;  // relative to the mesh's
    Eigen::Vector3f rounded;
    Eigen::Vector3f offset;  // rounded - origin
  };

  // A part of a block as one packet, whose constant fields are set. Returns the number of hits.
  template <typename Packet, typename Intersect>
  size_t CastPart(const BlockOrigin& from, const RayBlock& rays, size_t begin, Packet& packet,
                  HitBlock& hits, const Intersect& intersect) const {
    constexpr size_t kSize = embree::kPacketSize<Packet>;
    alignas(64) std::array<int, kSize> valid;
    alignas(64) std::array<int, kSize> grazes;
    const PacketDirections directions{packet.ray.dir_x, packet.ray.dir_y,  packet.ray.dir_z,
                                      packet.ray.tfar,  packet.hit.geomID, packet.hit.instID[0]};
    const PacketHits results{packet.ray.dir_x, packet.ray.dir_y,  packet.ray.dir_z,
                             packet.ray.tfar,  packet.hit.Ng_x,   packet.hit.Ng_y,
                             packet.hit.Ng_z,  packet.hit.geomID, packet.hit.primID};
    const size_t count = SetDirections<kSize>(rays, begin, directions, valid.data());
    if (count == 0) return 0;
    intersect(valid.data(), packet);
    const HitSummary first =
        TakeHits<kSize>(results, from.offset, valid.data(), begin, grazes.data(), hits);
    if (first.any_grazing) MarkGrazing(grazes, begin, hits);
    if (first.missed == 0 || first.missed == count) {  // all missed: the sky, not a vertex's gap
      return count - first.missed;
    }
    for (size_t i = 0; i < kSize; ++i) {
      const size_t k = begin + i;
      if (hits.triangle[k] != HitBlock::kNoTriangle) valid[i] = 0;
      if (valid[i] == 0) continue;
      const Eigen::Vector3f nudged = Nudged({rays.x[k], rays.y[k], rays.z[k]});
      packet.ray.dir_x[i] = nudged.x();
      packet.ray.dir_y[i] = nudged.y();
      packet.ray.dir_z[i] = nudged.z();
    }
    intersect(valid.data(), packet);
    const HitSummary second =
        TakeHits<kSize>(results, from.offset, valid.data(), begin, grazes.data(), hits);
    if (second.any_grazing) MarkGrazing(grazes, begin, hits);
    return count - second.missed;
  }

  template <size_t kSize>
  static void MarkGrazing(const std::array<int, kSize>& grazes, size_t begin, HitBlock& hits) {
    for (size_t i = 0; i < kSize; ++i) {
      hits.grazing |= (grazes[i] != 0 ? 1u : 0u) << (begin + i);
    }
  }

  template <typename Packet, typename Intersect>
  size_t CastAllBlocks(const BlockOrigin& from, std::span<const RayBlock> rays,
                       std::span<HitBlock> hits, const Intersect& intersect) const {
    alignas(64) Packet packet;
    embree::SetConstants(packet, from.rounded.data());
    size_t num_hits = 0;
    for (size_t block = 0; block < rays.size(); ++block) {
      for (size_t begin = 0; begin < RayBlock::kSize; begin += embree::kPacketSize<Packet>) {
        num_hits += CastPart(from, rays[block], begin, packet, hits[block], intersect);
      }
    }
    return num_hits;
  }

  size_t CastOneByOne(const Eigen::Vector3d& origin_in_world, const RayBlock& rays, HitBlock& hits,
                      embree::IntersectState& state) const {
    size_t num_hits = 0;
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      const Eigen::Vector3d direction =
          Eigen::Vector3f(rays.x[i], rays.y[i], rays.z[i]).cast<double>();
      const double length = direction.norm();
      const auto ray = MakeLocalRay(origin_in_world, direction, length);
      const auto hit = ray ? CastOne(*ray, 0, state) : std::nullopt;
      if (!hit) continue;
      const RayHit refined = Refine(*ray, length, hit->triangle, ray->shift + double{hit->t});
      hits.ray_t[i] = static_cast<float>(refined.ray_t);
      hits.triangle[i] = refined.triangle;
      hits.grazing |= 1u << i;  // the direction is in float here, too
      ++num_hits;
    }
    return num_hits;
  }

  size_t CastBlockBlended(const Eigen::Vector3d& origin_in_world, const RayBlock& rays,
                          HitBlock& hits, BlendState& state) const {
    size_t num_hits = 0;
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      const Eigen::Vector3d direction =
          Eigen::Vector3f(rays.x[i], rays.y[i], rays.z[i]).cast<double>();
      const auto hit = CastBlended({origin_in_world, direction}, state);
      if (!hit) continue;
      hits.ray_t[i] = static_cast<float>(hit->ray_t);
      hits.triangle[i] = hit->triangle;
      ++num_hits;
    }
    return num_hits;
  }

  struct FloatHit {
    uint32_t triangle;
    float t;
  };
  std::optional<FloatHit> CastOne(const LocalRay& ray, float t_near,
                                  embree::IntersectState& state) const {
    const auto cast = [&](const Eigen::Vector3f& direction) -> std::optional<FloatHit> {
      RTCRayHit ray_hit = embree::MakeRayHit(ray.float_origin.data(), direction.data(), t_near);
      state.Intersect1(scene.get(), &ray_hit);
      if (ray_hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
      return FloatHit{ray_hit.hit.primID, ray_hit.ray.tfar};
    };
    const auto hit = cast(ray.float_direction);
    return hit ? hit : cast(Nudged(ray.float_direction));
  }

  // Casts all, then refines all: the triangles and then their vertices, which are rarely in the
  // cache, are on their way meanwhile.
  void CastBatch(std::span<const Ray> rays, std::span<std::optional<RayHit>> hits,
                 embree::IntersectState& state) const {
    std::array<std::optional<LocalRay>, kBatch> local;
    std::array<double, kBatch> lengths;
    std::array<std::optional<FloatHit>, kBatch> float_hits;
    for (size_t i = 0; i < rays.size(); ++i) {
      lengths[i] = rays[i].direction_in_world.norm();
      local[i] = MakeLocalRay(rays[i].origin_in_world, rays[i].direction_in_world, lengths[i]);
      if (!local[i]) continue;
      float_hits[i] =
          CastOne(*local[i], FloatNear(*local[i], lengths[i], rays[i].ray_t_near), state);
      if (float_hits[i]) __builtin_prefetch(&mesh->triangles[float_hits[i]->triangle]);
    }
    for (size_t i = 0; i < rays.size(); ++i) {
      if (!float_hits[i]) continue;
      for (const uint32_t index : mesh->triangles[float_hits[i]->triangle]) {
        __builtin_prefetch(&mesh->vertices[index]);
      }
    }
    for (size_t i = 0; i < rays.size(); ++i) {
      if (!float_hits[i]) continue;
      hits[i] = Refine(*local[i], lengths[i], float_hits[i]->triangle,
                       local[i]->shift + double{float_hits[i]->t});
    }
  }

  static float FloatNear(const LocalRay& ray, double length, double t_near) {
    return static_cast<float>(std::max(0.0, t_near * length - ray.shift));
  }

  std::shared_ptr<const TriangleMesh> mesh;  // empty where there are surfels or splats
  std::shared_ptr<const Surfels> surfels;    // or null
  std::shared_ptr<const Splats> splats;      // or null
  SplatDepth splat_depth;
  std::vector<PackedSplat> packed_splats;
  std::vector<Eigen::Vector3f> padded_vectors;  // empty where the mesh's or surfels' own are shared
  Bounds bounds;
  double reach = 0;  // the largest local coordinate, about
  Error first_error;
  std::atomic<int64_t> memory_bytes{0};
  embree::Device device;
  embree::Scene scene;
  bool has_packets16 = false;
  bool has_packets8 = false;
};

RayCaster::RayCaster(std::shared_ptr<const TriangleMesh> mesh, const RayCasterOptions& options) {
  RAYLIFT_CHECK(mesh != nullptr);
  CheckIndices(*mesh);
  impl_ = std::make_unique<Impl>(std::move(mesh), nullptr, nullptr, SplatDepth::kMedian, options);
}

RayCaster::RayCaster(std::shared_ptr<const Surfels> surfels, const RayCasterOptions& options) {
  RAYLIFT_CHECK(surfels != nullptr);
  RAYLIFT_CHECK_EQ(surfels->discs.size(), surfels->normals.size());
  auto mesh = EmptyMeshAt(surfels->origin_in_world);
  impl_ = std::make_unique<Impl>(std::move(mesh), std::move(surfels), nullptr, SplatDepth::kMedian,
                                 options);
}

RayCaster::RayCaster(std::shared_ptr<const Splats> splats, SplatDepth depth,
                     const RayCasterOptions& options) {
  RAYLIFT_CHECK(splats != nullptr);
  auto mesh = EmptyMeshAt(splats->origin_in_world);
  impl_ = std::make_unique<Impl>(std::move(mesh), nullptr, std::move(splats), depth, options);
}

RayCaster::~RayCaster() = default;
RayCaster::RayCaster(RayCaster&&) noexcept = default;
RayCaster& RayCaster::operator=(RayCaster&&) noexcept = default;

const TriangleMesh& RayCaster::mesh() const { return *impl_->mesh; }

const Surfels* RayCaster::surfels() const { return impl_->surfels.get(); }

const Splats* RayCaster::splats() const { return impl_->splats.get(); }

SplatDepth RayCaster::splat_depth() const { return impl_->splat_depth; }

SurfaceKind RayCaster::kind() const {
  if (impl_->splats != nullptr) return SurfaceKind::kSplats;
  return impl_->surfels != nullptr ? SurfaceKind::kCloud : SurfaceKind::kMesh;
}

bool RayCaster::HitsHaveSigma() const { return impl_->IsBlended(); }

bool RayCaster::HasColors() const {
  if (impl_->splats != nullptr) return !impl_->splats->harmonics.empty();
  if (impl_->surfels != nullptr) return !impl_->surfels->colors_rgb.empty();
  return !mesh().vertex_colors_rgb.empty() || !mesh().triangle_textures.empty();
}

std::vector<std::optional<RayHit>> RayCaster::Cast(std::span<const Ray> rays) const {
  std::vector<std::optional<RayHit>> hits(rays.size());
  if (impl_->IsBlended()) {
    Impl::BlendState state(*impl_);
    for (size_t i = 0; i < rays.size(); ++i) hits[i] = impl_->CastBlended(rays[i], state);
    return hits;
  }
  embree::IntersectState state(embree::Coherence::kIncoherent);
  for (size_t begin = 0; begin < rays.size(); begin += kBatch) {
    const size_t count = std::min(kBatch, rays.size() - begin);
    impl_->CastBatch(rays.subspan(begin, count), std::span(hits).subspan(begin, count), state);
  }
  return hits;
}

size_t RayCaster::CastBlocks(const Eigen::Vector3d& origin_in_world, std::span<const RayBlock> rays,
                             std::span<HitBlock> hits) const {
  RAYLIFT_CHECK_EQ(rays.size(), hits.size());
  for (HitBlock& block : hits) {
    block.ray_t.fill(0);
    block.triangle.fill(HitBlock::kNoTriangle);
    block.grazing = 0;
  }
  const Impl& impl = *impl_;
  if (impl.IsBlended()) {
    Impl::BlendState state(impl);
    size_t num_hits = 0;
    for (size_t i = 0; i < rays.size(); ++i) {
      num_hits += impl.CastBlockBlended(origin_in_world, rays[i], hits[i], state);
    }
    return num_hits;
  }
  Impl::BlockOrigin from;
  from.origin = origin_in_world - impl.mesh->origin_in_world;
  from.rounded = from.origin.cast<float>();
  from.offset = (from.rounded.cast<double>() - from.origin).cast<float>();
  const double distance = (from.origin - impl.bounds.center).norm();
  embree::IntersectState state(embree::Coherence::kCoherent);
  if (!(distance <= kMaxBlockDistance * impl.bounds.radius) ||
      !(impl.has_packets16 || impl.has_packets8)) {
    size_t num_hits = 0;
    for (size_t i = 0; i < rays.size(); ++i) {
      num_hits += impl.CastOneByOne(origin_in_world, rays[i], hits[i], state);
    }
    return num_hits;
  }
  if (impl.has_packets16) {
    return impl.CastAllBlocks<RTCRayHit16>(from, rays, hits,
                                           [&](const int* valid, RTCRayHit16& packet) {
                                             state.Intersect16(valid, impl.scene.get(), &packet);
                                           });
  }
  return impl.CastAllBlocks<RTCRayHit8>(from, rays, hits,
                                        [&](const int* valid, RTCRayHit8& packet) {
                                          state.Intersect8(valid, impl.scene.get(), &packet);
                                        });
}

RayHit RayCaster::RefineHit(const Eigen::Vector3d& origin_in_world,
                            const Eigen::Vector3d& direction_in_world, uint32_t triangle,
                            double coarse_t) const {
  const double length = direction_in_world.norm();
  if (impl_->IsBlended()) {
    Impl::BlendState state(*impl_);
    const auto hit = impl_->CastBlended({origin_in_world, direction_in_world}, state);
    if (hit) return *hit;
    // The caller's direction was another one, by rounding.
    return {coarse_t, -direction_in_world / length, triangle, Eigen::Vector2d::Zero()};
  }
  LocalRay ray;
  ray.origin = origin_in_world - impl_->mesh->origin_in_world;
  ray.direction = direction_in_world / length;
  return impl_->Refine(ray, length, triangle, coarse_t * length);
}

size_t RayCaster::MemoryBytes() const {
  return static_cast<size_t>(std::max<int64_t>(impl_->memory_bytes, 0)) +
         impl_->packed_splats.size() * sizeof(PackedSplat);
}

void RayCaster::LookAtSplats(std::span<const Ray> rays, std::span<const Eigen::Vector3f> colors_rgb,
                             std::span<SplatLook> looks) const {
  RAYLIFT_CHECK(impl_->splats != nullptr);
  RAYLIFT_CHECK_EQ(rays.size(), looks.size());
  RAYLIFT_CHECK(colors_rgb.empty() || colors_rgb.size() == impl_->packed_splats.size());
  Impl::BlendState state(*impl_);
  for (size_t i = 0; i < rays.size(); ++i) looks[i] = impl_->Look(rays[i], colors_rgb, state);
}

bool RayCaster::IsOccluded(const Ray& ray) const {
  if (impl_->IsBlended()) return Cast({&ray, 1}).front().has_value();
  const double length = ray.direction_in_world.norm();
  const auto local = impl_->MakeLocalRay(ray.origin_in_world, ray.direction_in_world, length);
  if (!local) {
    return false;
  }
  embree::IntersectState state(embree::Coherence::kIncoherent);
  RTCRay embree_ray = embree::MakeRay(local->float_origin.data(), local->float_direction.data(),
                                      Impl::FloatNear(*local, length, ray.ray_t_near));
  state.Occluded1(impl_->scene.get(), &embree_ray);
  return embree_ray.tfar < 0;
}

}  // namespace raylift
