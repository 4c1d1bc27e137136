#include "unseen_mesh.h"

#include <array>
#include <cmath>

#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using Box = Eigen::AlignedBox3d;

std::string Text(const Box& box) {
  const Eigen::Vector3d low = box.min();
  const Eigen::Vector3d high = box.max();
  return fmt::format("({:.4g}, {:.4g}, {:.4g}) to ({:.4g}, {:.4g}, {:.4g})", low.x(), low.y(),
                     low.z(), high.x(), high.y(), high.z());
}

Box BoxOf(const RayCaster& scene) {
  Box box;
  if (const Surfels* surfels = scene.surfels()) {
    for (const Eigen::Vector4f& disc : surfels->discs) {
      box.extend(surfels->origin_in_world + disc.head<3>().cast<double>());
    }
    return box;
  }
  if (const Splats* splats = scene.splats()) {
    for (const Eigen::Vector3f& mean : splats->means) {
      box.extend(splats->origin_in_world + mean.cast<double>());
    }
    return box;
  }
  const TriangleMesh& mesh = scene.mesh();
  for (uint32_t i = 0; i < mesh.vertices.size(); ++i) box.extend(mesh.VertexInWorld(i));
  return box;
}

// Whether the cameras stand in the mesh's box or no further from it than it is large.
bool AreNear(const Box& cameras, const Box& mesh) {
  return cameras.exteriorDistance(mesh) <= mesh.diagonal().norm();
}

std::string Reason(const Box& cameras, const Box& mesh) {
  if (AreNear(cameras, mesh)) {
    return "they look elsewhere: are the axes turned (axes=), or the poses inverted?";
  }
  for (const double factor : {1000.0, 100.0, 10.0}) {
    for (const double scale : {factor, 1 / factor}) {
      const Box scaled(scale * mesh.min(), scale * mesh.max());
      if (AreNear(cameras, scaled) && cameras.diagonal().norm() <= 10 * scaled.diagonal().norm()) {
        return fmt::format("is it in another unit (with scale={:g} they would meet)?", scale);
      }
    }
  }
  return "is it in another frame (scale=, axes=, shift=)?";
}

}  // namespace

std::string WhyTheMeshIsUnseen(const RayCaster& scene,
                               const std::vector<Eigen::Vector3d>& camera_centers) {
  RAYLIFT_CHECK(!camera_centers.empty());
  const Box mesh_box = BoxOf(scene);
  Box camera_box;
  for (const Eigen::Vector3d& center : camera_centers) camera_box.extend(center);
  return fmt::format("none of {} images sees the {}, which is at {}; the cameras are at {}: {}",
                     camera_centers.size(), ToString(scene.kind()), Text(mesh_box),
                     Text(camera_box), Reason(camera_box, mesh_box));
}

}  // namespace raylift
