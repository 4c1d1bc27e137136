// A room seen by its mesh, and the same depth made worse in known ways.

#pragma once

#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "support/meshes.h"

#include "raylift/evaluation/perturbation.h"
#include "raylift/lifting/depth_source.h"
#include "raylift/lifting/mesh_source.h"
#include "raylift/renderers/frame_renderer.h"

namespace raylift {

// Depth maps in memory.
class MapSource final : public GeometrySource {
 public:
  explicit MapSource(std::function<DepthMap(const PosedImage&)> map) : map_(std::move(map)) {}

  std::string Description() const override { return "maps"; }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& image, std::span<const Eigen::Vector2d> pixels) const override {
    return LiftByDepthMap(MapOf(image), image, pixels);
  }

 private:
  const DepthMap& MapOf(const PosedImage& image) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto [found, is_new] = maps_.try_emplace(image.name);
    if (is_new) found->second = map_(image);
    return found->second;
  }

  std::function<DepthMap(const PosedImage&)> map_;
  mutable std::mutex mutex_;
  mutable std::map<std::string, DepthMap> maps_;
};

// A box to stand in, with two smaller ones in it; cameras in a ring look across.
struct ComparedRoom {
  std::shared_ptr<const TriangleMesh> mesh;
  std::shared_ptr<const RayCaster> caster;
  MeshSource truth;
  std::vector<PosedImage> images;

  explicit ComparedRoom(int num_images = 6)
      : mesh(MakeRoom()),
        caster(std::make_shared<const RayCaster>(mesh)),
        truth("mesh:room", caster) {
    const double params[] = {150, 150, 96, 72};
    const Camera camera(CameraModel::kPinhole, 192, 144, params);
    for (int i = 0; i < num_images; ++i) {
      const double angle = 0.25 * i;
      images.push_back({"r" + std::to_string(i), camera,
                        LookAt({2.4 * std::sin(angle), 0.3 * (i % 3) - 0.3, -2 * std::cos(angle)},
                               {0.3 * (i % 2), 0, 1})});
    }
  }

  MapSource Perturbed(const DepthPerturbation& perturbation) const {
    return MapSource(PerturbedMaps(perturbation));
  }
  std::shared_ptr<const MapSource> Shared(const DepthPerturbation& perturbation) const {
    return std::make_shared<const MapSource>(PerturbedMaps(perturbation));
  }
  std::shared_ptr<const MapSource> Scaled(double factor) const { return Shared({.scale = factor}); }
  std::shared_ptr<const MeshSource> SharedTruth() const {
    return std::make_shared<const MeshSource>(truth);
  }

 private:
  std::function<DepthMap(const PosedImage&)> PerturbedMaps(
      const DepthPerturbation& perturbation) const {
    return [caster = caster, perturbation](const PosedImage& image) {
      return PerturbDepth(RenderDepth(*caster, image.camera, image.cam_from_world, 1), perturbation,
                          image.name);
    };
  }

  static std::shared_ptr<const TriangleMesh> MakeRoom() {
    std::vector<Eigen::Vector3d> positions;
    std::vector<std::array<uint32_t, 3>> triangles;
    for (const TriangleMesh& part :
         {MakeBox({0, 0, 0}, {4, 3, 5}), MakeBox({-1, 1, 1}, {0.6, 2, 0.5}),
          MakeBox({1.2, 2, 1.5}, {0.5, 1.2, 0.7})}) {
      const auto offset = static_cast<uint32_t>(positions.size());
      for (uint32_t i = 0; i < part.vertices.size(); ++i) {
        positions.push_back(part.VertexInWorld(i));
      }
      for (const auto& t : part.triangles) {
        triangles.push_back({t[0] + offset, t[1] + offset, t[2] + offset});
      }
    }
    return std::make_shared<const TriangleMesh>(MeshOfShape(positions, triangles));
  }
};

}  // namespace raylift
