// A mesh, discs or splats as Embree holds them: in float, about an origin near them.

#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "renderers/embree_shim.h"
#include "renderers/splat_blend.h"
#include <Eigen/Core>

#include "raylift/renderers/ray_caster.h"

namespace raylift {

// Where a hit in float and its refinement in double are further apart than this share of the
// scene's size, float's is the better one.
inline constexpr double kMaxRefinementOfScene = 4e-6;

struct EmbreeSurface {
  struct Bounds {
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    double radius = 0;
  };
  // The first error that Embree reports while it builds.
  struct Error {
    RTCError code = RTC_ERROR_NONE;
    std::string message;
  };

  // Builds the tree. `surfels` and `splats` may be null; with one of them the mesh is empty.
  EmbreeSurface(std::shared_ptr<const TriangleMesh> mesh_in,
                std::shared_ptr<const Surfels> surfels_in, std::shared_ptr<const Splats> splats_in,
                SplatDepth splat_depth_in, const RayCasterOptions& options);

  // Returns whether the surface consists of discs or splats, which rays blend.
  bool IsBlended() const { return surfels != nullptr || splats != nullptr; }

  std::shared_ptr<const TriangleMesh> mesh;
  std::shared_ptr<const Surfels> surfels;
  std::shared_ptr<const Splats> splats;
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

 private:
  const std::vector<Eigen::Vector3f>& Padded(const std::vector<Eigen::Vector3f>& vectors);
  void BuildScene(const RayCasterOptions& options);
  void Attach(const embree::Geometry& geometry, RTCBuildQuality quality);
  void AttachMesh(RTCBuildQuality quality);
  void AttachSurfels(RTCBuildQuality quality);
  void AttachSplats(RTCBuildQuality quality);
};

}  // namespace raylift
