#include "renderers/embree_surface.h"

#include <algorithm>
#include <functional>
#include <mutex>
#include <new>
#include <stdexcept>

#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

EmbreeSurface::Bounds BoundsOf(const Eigen::AlignedBox3f& box) {
  const Eigen::Vector3d low = box.min().cast<double>();
  const Eigen::Vector3d high = box.max().cast<double>();
  return {0.5 * (low + high), 0.5 * (high - low).norm()};
}

EmbreeSurface::Bounds BoundsOf(const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) return {};
  Eigen::AlignedBox3f box;
  for (const auto& triangle : mesh.triangles) {
    for (const uint32_t index : triangle) box.extend(mesh.vertices[index]);
  }
  return BoundsOf(box);
}

EmbreeSurface::Bounds BoundsOf(const Surfels& surfels) {
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

EmbreeSurface::Bounds BoundsOf(const std::vector<PackedSplat>& splats) {
  Eigen::AlignedBox3f box;
  for (const PackedSplat& splat : splats) box.extend(BoxOf(splat));
  return BoundsOf(box);
}

// Keeps the first error.
void OnError(void* error, RTCError code, const char* message) {
  auto& stored = *static_cast<EmbreeSurface::Error*>(error);
  if (stored.code != RTC_ERROR_NONE) return;
  stored.code = code;
  stored.message = message != nullptr ? message : "no text";
}

// Throws for an error of Embree. What Embree takes is checked before, so that an unknown error is
// one of TBB, which could not start a thread.
[[noreturn]] void ThrowError(const EmbreeSurface::Error& error) {
  if (error.code == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
  const std::string text =
      fmt::format("Embree: error {}: {}", static_cast<int>(error.code), error.message);
  if (error.code == RTC_ERROR_UNKNOWN) throw ResourceError(text);
  throw std::runtime_error(text);
}

bool OnMemory(void* counter, ssize_t bytes, bool) {
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

void OnSplatBounds(const RTCBoundsFunctionArguments* arguments) {
  const auto& self = *static_cast<const EmbreeSurface*>(arguments->geometryUserPtr);
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

}  // namespace

EmbreeSurface::EmbreeSurface(std::shared_ptr<const TriangleMesh> mesh_in,
                             std::shared_ptr<const Surfels> surfels_in,
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
  rtcSetDeviceErrorFunction(device.get(), &OnError, &first_error);
  rtcSetDeviceMemoryMonitorFunction(device.get(), &OnMemory, &memory_bytes);
  has_packets16 = rtcGetDeviceProperty(device.get(), RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED);
  has_packets8 = rtcGetDeviceProperty(device.get(), RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED);
  BuildScene(options);
  if (first_error.code != RTC_ERROR_NONE) ThrowError(first_error);
  // Later errors would come from many threads; a valid scene has none.
  rtcSetDeviceErrorFunction(device.get(), nullptr, nullptr);
}

void EmbreeSurface::BuildScene(const RayCasterOptions& options) {
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
const std::vector<Eigen::Vector3f>& EmbreeSurface::Padded(
    const std::vector<Eigen::Vector3f>& vectors) {
  if (vectors.capacity() > vectors.size()) return vectors;
  padded_vectors.reserve(vectors.size() + 1);
  padded_vectors = vectors;
  return padded_vectors;
}

void EmbreeSurface::AttachMesh(RTCBuildQuality quality) {
  const embree::Geometry geometry(rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
  const std::vector<Eigen::Vector3f>& vertices = Padded(mesh->vertices);
  rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                             vertices.data(), 0, sizeof(Eigen::Vector3f), vertices.size());
  rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                             mesh->triangles.data(), 0, 3 * sizeof(uint32_t),
                             mesh->triangles.size());
  Attach(geometry, quality);
}

void EmbreeSurface::AttachSurfels(RTCBuildQuality quality) {
  const embree::Geometry geometry(
      rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_ORIENTED_DISC_POINT));
  rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4,
                             surfels->discs.data(), 0, sizeof(Eigen::Vector4f),
                             surfels->discs.size());
  const std::vector<Eigen::Vector3f>& normals = Padded(surfels->normals);
  rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_NORMAL, 0, RTC_FORMAT_FLOAT3,
                             normals.data(), 0, sizeof(Eigen::Vector3f), normals.size());
  embree::GatherState::Allow(scene.get(), geometry.get());
  Attach(geometry, quality);
}

void EmbreeSurface::AttachSplats(RTCBuildQuality quality) {
  const embree::Geometry geometry(rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_USER));
  rtcSetGeometryUserPrimitiveCount(geometry.get(), static_cast<unsigned>(packed_splats.size()));
  rtcSetGeometryUserData(geometry.get(), this);
  rtcSetGeometryBoundsFunction(geometry.get(), &OnSplatBounds, nullptr);
  embree::VisitState<SplatVisitor>::Allow(geometry.get());
  Attach(geometry, quality);
}

void EmbreeSurface::Attach(const embree::Geometry& geometry, RTCBuildQuality quality) {
  rtcSetGeometryBuildQuality(geometry.get(), quality);
  rtcCommitGeometry(geometry.get());
  rtcAttachGeometry(scene.get(), geometry.get());
}

}  // namespace raylift
