#include "bare_loop.h"

#include <limits>

#include "renderers/embree_shim.h"
#include <pmmintrin.h>
#include <xmmintrin.h>

namespace raylift {

struct BareLoop::Impl {
  embree::Device device;
  embree::Scene scene;
};

BareLoop::BareLoop(const TriangleMesh& mesh, SceneFlag flag) : impl_(std::make_unique<Impl>()) {
  impl_->device.reset(rtcNewDevice(nullptr));
  impl_->scene.reset(rtcNewScene(impl_->device.get()));
  const RTCScene scene = impl_->scene.get();
  rtcSetSceneFlags(scene, flag == SceneFlag::kRobust ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE);
  const embree::Geometry geometry(rtcNewGeometry(impl_->device.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
  rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                             mesh.vertices.data(), 0, 12, mesh.vertices.size());
  rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                             mesh.triangles.data(), 0, 12, mesh.triangles.size());
  rtcCommitGeometry(geometry.get());
  rtcAttachGeometry(scene, geometry.get());
  rtcCommitScene(scene);
}

BareLoop::~BareLoop() = default;

void BareLoop::Cast(std::span<const BareRay> rays, std::span<float> ray_t) const {
  embree::IntersectState state(embree::Coherence::kIncoherent);
  for (size_t i = 0; i < rays.size(); ++i) {
    RTCRayHit ray = embree::MakeRayHit(rays[i].origin.data(), rays[i].direction.data(), 0);
    state.Intersect1(impl_->scene.get(), &ray);
    ray_t[i] = ray.ray.tfar;
  }
}

void BareLoop::CastPixels(const Camera& camera, const Rigid3& cam_from_world,
                          std::span<const Eigen::Vector2d> pixels, std::span<float> ray_t) const {
  embree::IntersectState state(embree::Coherence::kIncoherent);
  const Eigen::Matrix3d r = cam_from_world.rotation.conjugate().toRotationMatrix();
  const Eigen::Vector3f origin = cam_from_world.OriginInSource().cast<float>();
  const Eigen::Vector2d pp = camera.principal_point_px();
  for (size_t i = 0; i < pixels.size(); ++i) {
    const Eigen::Vector3f direction =
        (r * Eigen::Vector3d((pixels[i].x() - pp.x()) / camera.focal_x_px(),
                             (pixels[i].y() - pp.y()) / camera.focal_y_px(), 1))
            .normalized()
            .cast<float>();
    RTCRayHit ray = embree::MakeRayHit(origin.data(), direction.data(), 0);
    state.Intersect1(impl_->scene.get(), &ray);
    ray_t[i] = ray.ray.tfar;
  }
}

void BareLoop::Render(const Camera& camera, const Rigid3& cam_from_world,
                      std::vector<float>& depth) const {
  _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
  _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
  const int width = camera.width_px();
  depth.resize(static_cast<size_t>(width) * static_cast<size_t>(camera.height_px()));
  const Eigen::Matrix3f r = cam_from_world.rotation.conjugate().toRotationMatrix().cast<float>();
  const auto fx = static_cast<float>(camera.focal_x_px());
  const auto fy = static_cast<float>(camera.focal_y_px());
  const Eigen::Vector2f pp = camera.principal_point_px().cast<float>();
  const Eigen::Vector3f a = r.col(0) / fx;
  const Eigen::Vector3f b = r.col(1) / fy;
  const Eigen::Vector3f c = r.col(2) - pp.x() * a - pp.y() * b;
  const Eigen::Vector3f o = cam_from_world.OriginInSource().cast<float>();
  embree::IntersectState state(embree::Coherence::kCoherent);
  alignas(64) RTCRayHit16 packet;
  alignas(64) int valid[16];
  for (int& v : valid) v = -1;
  embree::SetConstants(packet, o.data());
  for (int tile_y = 0; tile_y < camera.height_px(); tile_y += 8) {
    for (int tile_x = 0; tile_x < width; tile_x += 8) {
      for (int block = 0; block < 4; ++block) {
        const int x0 = tile_x + block % 2 * 4;
        const int y0 = tile_y + block / 2 * 4;
        for (int i = 0; i < 16; ++i) {
          const int row = i / 4;
          const float x = static_cast<float>(x0 + i % 4) + 0.5f;
          const float y = static_cast<float>(y0 + row) + 0.5f;
          packet.ray.dir_x[i] = c.x() + x * a.x() + y * b.x();
          packet.ray.dir_y[i] = c.y() + x * a.y() + y * b.y();
          packet.ray.dir_z[i] = c.z() + x * a.z() + y * b.z();
          packet.ray.tfar[i] = std::numeric_limits<float>::infinity();
          packet.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
          packet.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
        }
        state.Intersect16(valid, impl_->scene.get(), &packet);
        for (int i = 0; i < 16; ++i) {
          const size_t row = static_cast<size_t>(y0 + i / 4) * static_cast<size_t>(width);
          depth[row + static_cast<size_t>(x0 + i % 4)] = packet.ray.tfar[i];
        }
      }
    }
  }
}

}  // namespace raylift
