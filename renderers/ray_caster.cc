#include "raylift/renderers/ray_caster.h"

#include <algorithm>
#include <cmath>

#include "renderers/block_kernels.h"
#include "renderers/disc_blend.h"
#include "renderers/embree_surface.h"
#include <Eigen/Geometry>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr size_t kBatch = 64;

// Where a hit in float and its refinement in double are further apart than this share of the ray's
// length and kMaxRefinementOfScene, the ray grazes the triangle's plane, and float's is the better
// one.
constexpr double kMaxRefinementOfRay = 1e-3;

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

// Embree takes no origin beyond half the root of the largest float.
constexpr float kMostOfOrigin = 1e18f;

// Returns a ray as Embree gets it; `length` is that of the direction. nullopt if a number is not
// finite or too large, or the direction has no length.
std::optional<LocalRay> MakeLocalRay(const EmbreeSurface& surface,
                                     const Eigen::Vector3d& origin_in_world,
                                     const Eigen::Vector3d& direction, double length) {
  LocalRay ray;
  ray.origin = origin_in_world - surface.mesh->origin_in_world;
  ray.direction = direction / length;
  const double nearest = (surface.bounds.center - ray.origin).dot(ray.direction);
  ray.shift = std::max(0.0, nearest - 2 * surface.bounds.radius);
  ray.float_origin = (ray.origin + ray.shift * ray.direction).cast<float>();
  ray.float_direction = ray.direction.cast<float>();
  if (!ray.float_origin.allFinite() || !ray.float_direction.allFinite()) return std::nullopt;
  if (!(ray.float_origin.cwiseAbs().maxCoeff() < kMostOfOrigin)) return std::nullopt;
  return ray;
}

float FloatNear(const LocalRay& ray, double length, double t_near) {
  return static_cast<float>(std::max(0.0, t_near * length - ray.shift));
}

// Returns the hit with the triangle's plane, in double. `length` is that of the caller's direction.
RayHit Refine(const EmbreeSurface& surface, const LocalRay& ray, double length, uint32_t triangle,
              double coarse_t) {
  const auto& [i0, i1, i2] = surface.mesh->triangles[triangle];
  const Eigen::Vector3d v0 = surface.mesh->vertices[i0].cast<double>();
  const Eigen::Vector3d e1 = surface.mesh->vertices[i1].cast<double>() - v0;
  const Eigen::Vector3d e2 = surface.mesh->vertices[i2].cast<double>() - v0;
  const Eigen::Vector3d normal = e1.cross(e2);
  double t = (v0 - ray.origin).dot(normal) / ray.direction.dot(normal);
  if (!(std::abs(t - coarse_t) <=
        kMaxRefinementOfRay * std::abs(coarse_t) + kMaxRefinementOfScene * surface.reach)) {
    t = coarse_t;
  }
  const Eigen::Vector3d offset = ray.origin + t * ray.direction - v0;
  const double scale = 1 / normal.squaredNorm();
  const double u = std::clamp(offset.cross(e2).dot(normal) * scale, 0.0, 1.0);
  const double v = std::clamp(e1.cross(offset).dot(normal) * scale, 0.0, 1.0 - u);
  return {t / length, normal.normalized(), triangle, {u, v}};
}

struct FloatHit {
  uint32_t triangle;
  float t;
};
std::optional<FloatHit> CastOne(const EmbreeSurface& surface, const LocalRay& ray, float t_near,
                                embree::IntersectState& state) {
  const auto cast = [&](const Eigen::Vector3f& direction) -> std::optional<FloatHit> {
    RTCRayHit ray_hit = embree::MakeRayHit(ray.float_origin.data(), direction.data(), t_near);
    state.Intersect1(surface.scene.get(), &ray_hit);
    if (ray_hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
    return FloatHit{ray_hit.hit.primID, ray_hit.ray.tfar};
  };
  const auto hit = cast(ray.float_direction);
  return hit ? hit : cast(Nudged(ray.float_direction));
}

// Casts rays one by one, and blends what they meet.
class BlendedCaster {
 public:
  explicit BlendedCaster(const EmbreeSurface& surface)
      : surface_(surface), visitor_(surface.packed_splats) {}

  std::optional<RayHit> Cast(const Ray& ray) {
    return surface_.splats != nullptr ? Look(ray, {}).hit : CastAtDiscs(ray);
  }

  SplatLook Look(const Ray& world_ray, std::span<const Eigen::Vector3f> colors_rgb) {
    const double length = world_ray.direction_in_world.norm();
    const auto local =
        MakeLocalRay(surface_, world_ray.origin_in_world, world_ray.direction_in_world, length);
    if (!local) return {};
    const SplatRay ray{local->origin, local->direction};
    visitor_.Start(ray, world_ray.ray_t_near * length, local->shift);
    visit_.Visit(surface_.scene.get(), local->float_origin.data(), local->float_direction.data(),
                 FloatNear(*local, length, world_ray.ray_t_near));
    const SplatBlend blend = BlendSplats(surface_.packed_splats, ray, visitor_.Finish(),
                                         surface_.splat_depth, colors_rgb);
    SplatLook look{std::nullopt, blend.color, blend.transmittance};
    if (const auto& surface = blend.surface) {
      const double along = std::abs(surface->normal.dot(ray.direction));
      look.hit = RayHit{surface->t / length, surface->normal, surface->heaviest,
                        Eigen::Vector2d::Zero(), surface->sigma_along_ray * along};
    }
    return look;
  }

 private:
  // Returns the first surface that discs make on the ray; nullopt where there is none.
  std::optional<RayHit> CastAtDiscs(const Ray& world_ray) {
    const double length = world_ray.direction_in_world.norm();
    const auto local =
        MakeLocalRay(surface_, world_ray.origin_in_world, world_ray.direction_in_world, length);
    if (!local) return std::nullopt;
    const LocalRay& ray = *local;
    float near = FloatNear(ray, length, world_ray.ray_t_near);
    const DiscRay disc_ray{ray.origin, ray.direction};
    const double rounding = kMaxRefinementOfScene * surface_.reach;
    while (const auto first = CastOne(surface_, ray, near, intersect_)) {
      const float begin = std::max(near, first->t - static_cast<float>(rounding));
      const double end =
          double{first->t} + BlendReach(*surface_.surfels, disc_ray, first->triangle);
      std::vector<uint32_t>& discs =
          gather_.Gather(surface_.scene.get(), ray.float_origin.data(), ray.float_direction.data(),
                         begin, static_cast<float>(end));
      std::sort(discs.begin(), discs.end());  // sums do not depend on the tree
      const Blend blend = BlendDiscs(*surface_.surfels, disc_ray, first->triangle, discs, rounding);
      if (blend.hit) {
        return RayHit{blend.hit->t / length, blend.hit->normal, blend.hit->nearest,
                      Eigen::Vector2d::Zero(), blend.hit->sigma};
      }
      near = std::nextafter(std::max(first->t, static_cast<float>(blend.last_t - ray.shift)),
                            std::numeric_limits<float>::infinity());
    }
    return std::nullopt;
  }

  const EmbreeSurface& surface_;
  embree::IntersectState intersect_{embree::Coherence::kIncoherent};
  embree::GatherState gather_;
  SplatVisitor visitor_;
  embree::VisitState<SplatVisitor> visit_{visitor_};
};

// The origin of a block's rays in float, and its rounding error.
struct BlockOrigin {
  Eigen::Vector3d origin;  // relative to the mesh's
  Eigen::Vector3f rounded;
  Eigen::Vector3f offset;  // rounded - origin
};

template <size_t kSize>
void MarkGrazing(const std::array<int, kSize>& grazes, size_t begin, HitBlock& hits) {
  for (size_t i = 0; i < kSize; ++i) hits.grazing |= (grazes[i] != 0 ? 1u : 0u) << (begin + i);
}

// Casts a part of a block as one packet, whose constant fields are set. Returns the number of hits.
template <typename Packet, typename Intersect>
size_t CastPart(const BlockOrigin& from, const RayBlock& rays, size_t begin, Packet& packet,
                HitBlock& hits, const Intersect& intersect) {
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

template <typename Packet, typename Intersect>
size_t CastAllBlocks(const BlockOrigin& from, std::span<const RayBlock> rays,
                     std::span<HitBlock> hits, const Intersect& intersect) {
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

size_t CastOneByOne(const EmbreeSurface& surface, const Eigen::Vector3d& origin_in_world,
                    const RayBlock& rays, HitBlock& hits, embree::IntersectState& state) {
  size_t num_hits = 0;
  for (size_t i = 0; i < RayBlock::kSize; ++i) {
    const Eigen::Vector3d direction =
        Eigen::Vector3f(rays.x[i], rays.y[i], rays.z[i]).cast<double>();
    const double length = direction.norm();
    const auto ray = MakeLocalRay(surface, origin_in_world, direction, length);
    const auto hit = ray ? CastOne(surface, *ray, 0, state) : std::nullopt;
    if (!hit) continue;
    const RayHit refined =
        Refine(surface, *ray, length, hit->triangle, ray->shift + double{hit->t});
    hits.ray_t[i] = static_cast<float>(refined.ray_t);
    hits.triangle[i] = refined.triangle;
    hits.grazing |= 1u << i;  // the direction is in float here, too
    ++num_hits;
  }
  return num_hits;
}

size_t CastBlockBlended(const Eigen::Vector3d& origin_in_world, const RayBlock& rays,
                        HitBlock& hits, BlendedCaster& caster) {
  size_t num_hits = 0;
  for (size_t i = 0; i < RayBlock::kSize; ++i) {
    const Eigen::Vector3d direction =
        Eigen::Vector3f(rays.x[i], rays.y[i], rays.z[i]).cast<double>();
    const auto hit = caster.Cast({origin_in_world, direction});
    if (!hit) continue;
    hits.ray_t[i] = static_cast<float>(hit->ray_t);
    hits.triangle[i] = hit->triangle;
    ++num_hits;
  }
  return num_hits;
}

// Casts all, then refines all: the triangles and then their vertices, which are rarely in the
// cache, are on their way meanwhile.
void CastBatch(const EmbreeSurface& surface, std::span<const Ray> rays,
               std::span<std::optional<RayHit>> hits, embree::IntersectState& state) {
  std::array<std::optional<LocalRay>, kBatch> local;
  std::array<double, kBatch> lengths;
  std::array<std::optional<FloatHit>, kBatch> float_hits;
  for (size_t i = 0; i < rays.size(); ++i) {
    lengths[i] = rays[i].direction_in_world.norm();
    local[i] =
        MakeLocalRay(surface, rays[i].origin_in_world, rays[i].direction_in_world, lengths[i]);
    if (!local[i]) continue;
    float_hits[i] =
        CastOne(surface, *local[i], FloatNear(*local[i], lengths[i], rays[i].ray_t_near), state);
    if (float_hits[i]) __builtin_prefetch(&surface.mesh->triangles[float_hits[i]->triangle]);
  }
  for (size_t i = 0; i < rays.size(); ++i) {
    if (!float_hits[i]) continue;
    for (const uint32_t index : surface.mesh->triangles[float_hits[i]->triangle]) {
      __builtin_prefetch(&surface.mesh->vertices[index]);
    }
  }
  for (size_t i = 0; i < rays.size(); ++i) {
    if (!float_hits[i]) continue;
    hits[i] = Refine(surface, *local[i], lengths[i], float_hits[i]->triangle,
                     local[i]->shift + double{float_hits[i]->t});
  }
}

// Returns an empty mesh, from which rays at surfels and splats take their origin.
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

struct RayCaster::Impl : EmbreeSurface {
  using EmbreeSurface::EmbreeSurface;
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
    BlendedCaster caster(*impl_);
    for (size_t i = 0; i < rays.size(); ++i) hits[i] = caster.Cast(rays[i]);
    return hits;
  }
  embree::IntersectState state(embree::Coherence::kIncoherent);
  for (size_t begin = 0; begin < rays.size(); begin += kBatch) {
    const size_t count = std::min(kBatch, rays.size() - begin);
    CastBatch(*impl_, rays.subspan(begin, count), std::span(hits).subspan(begin, count), state);
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
  const EmbreeSurface& impl = *impl_;
  if (impl.IsBlended()) {
    BlendedCaster caster(impl);
    size_t num_hits = 0;
    for (size_t i = 0; i < rays.size(); ++i) {
      num_hits += CastBlockBlended(origin_in_world, rays[i], hits[i], caster);
    }
    return num_hits;
  }
  BlockOrigin from;
  from.origin = origin_in_world - impl.mesh->origin_in_world;
  from.rounded = from.origin.cast<float>();
  from.offset = (from.rounded.cast<double>() - from.origin).cast<float>();
  const double distance = (from.origin - impl.bounds.center).norm();
  embree::IntersectState state(embree::Coherence::kCoherent);
  if (!(distance <= kMaxBlockDistance * impl.bounds.radius) ||
      !(impl.has_packets16 || impl.has_packets8)) {
    size_t num_hits = 0;
    for (size_t i = 0; i < rays.size(); ++i) {
      num_hits += CastOneByOne(impl, origin_in_world, rays[i], hits[i], state);
    }
    return num_hits;
  }
  if (impl.has_packets16) {
    return CastAllBlocks<RTCRayHit16>(from, rays, hits, [&](const int* valid, RTCRayHit16& packet) {
      state.Intersect16(valid, impl.scene.get(), &packet);
    });
  }
  return CastAllBlocks<RTCRayHit8>(from, rays, hits, [&](const int* valid, RTCRayHit8& packet) {
    state.Intersect8(valid, impl.scene.get(), &packet);
  });
}

RayHit RayCaster::RefineHit(const Eigen::Vector3d& origin_in_world,
                            const Eigen::Vector3d& direction_in_world, uint32_t triangle,
                            double coarse_t) const {
  const double length = direction_in_world.norm();
  if (impl_->IsBlended()) {
    BlendedCaster caster(*impl_);
    const auto hit = caster.Cast({origin_in_world, direction_in_world});
    if (hit) return *hit;
    // The caller's direction was another one, by rounding.
    return {coarse_t, -direction_in_world / length, triangle, Eigen::Vector2d::Zero()};
  }
  LocalRay ray;
  ray.origin = origin_in_world - impl_->mesh->origin_in_world;
  ray.direction = direction_in_world / length;
  return Refine(*impl_, ray, length, triangle, coarse_t * length);
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
  BlendedCaster caster(*impl_);
  for (size_t i = 0; i < rays.size(); ++i) looks[i] = caster.Look(rays[i], colors_rgb);
}

bool RayCaster::IsOccluded(const Ray& ray) const {
  if (impl_->IsBlended()) return Cast({&ray, 1}).front().has_value();
  const double length = ray.direction_in_world.norm();
  const auto local = MakeLocalRay(*impl_, ray.origin_in_world, ray.direction_in_world, length);
  if (!local) return false;
  embree::IntersectState state(embree::Coherence::kIncoherent);
  RTCRay embree_ray = embree::MakeRay(local->float_origin.data(), local->float_direction.data(),
                                      FloatNear(*local, length, ray.ray_t_near));
  state.Occluded1(impl_->scene.get(), &embree_ray);
  return embree_ray.tfar < 0;
}

}  // namespace raylift
