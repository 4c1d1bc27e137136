// A room with known walls, photographed from inside, and its geometry read wrongly on purpose.

#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/rng.h"
#include "support/meshes.h"

#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/mesh_source.h"

namespace raylift {

// Depth of another source, changed per reference and pixel.
class DistortedSource final : public GeometrySource {
 public:
  using Distortion = std::function<double(const PosedImage&, const Eigen::Vector2d&, double z)>;

  DistortedSource(std::shared_ptr<const GeometrySource> source, Distortion distortion)
      : source_(std::move(source)), distortion_(std::move(distortion)) {}

  std::string Description() const override { return "distorted"; }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override {
    auto points = source_->Lift(reference, pixels);
    const Eigen::Vector3d center = reference.cam_from_world.OriginInSource();
    for (size_t i = 0; i < points.size(); ++i) {
      if (!points[i]) continue;
      const double z = distortion_(reference, pixels[i], points[i]->depth_z);
      const double factor = z / points[i]->depth_z;
      points[i]->point_in_world = center + factor * (points[i]->point_in_world - center);
      points[i]->depth_z = z;
    }
    return points;
  }

 private:
  std::shared_ptr<const GeometrySource> source_;
  Distortion distortion_;
};

// A box of 8 x 6 x 10 around the origin; it is convex, so that nothing hides anything.
struct Room {
  std::shared_ptr<const GeometrySource> walls = std::make_shared<MeshSource>(
      "mesh:room", std::make_shared<const RayCaster>(
                       std::make_shared<const TriangleMesh>(MakeBox({0, 0, 0}, {4, 3, 5}))));
  std::vector<PosedImage> references;

  Room(int num_references, Rng& rng) {
    const double params[] = {500, 510, 322, 238};
    const Camera camera(CameraModel::kPinhole, 640, 480, params);
    for (int i = 0; i < num_references; ++i) {
      const Eigen::Vector3d center(rng.Uniform(-1.5, 1.5), rng.Uniform(-1, 1), rng.Uniform(-3, -1));
      const Eigen::Vector3d target(rng.Uniform(-1, 1), rng.Uniform(-1, 1), 4);
      references.push_back({"r" + std::to_string(i), camera, LookAt(center, target)});
    }
  }

  // Keypoints of a with their true places in b, moved by noise of this deviation.
  std::vector<ReferenceMatch> Match(int a, int b, int count, double noise_px, Rng& rng) const {
    const PosedImage& from = references[static_cast<size_t>(a)];
    const PosedImage& to = references[static_cast<size_t>(b)];
    std::vector<Eigen::Vector2d> pixels;
    for (int i = 0; i < count; ++i) pixels.emplace_back(rng.Uniform(0, 640), rng.Uniform(0, 480));
    const auto points = walls->Lift(from, pixels);
    std::vector<ReferenceMatch> matches;
    for (size_t i = 0; i < pixels.size(); ++i) {
      const auto seen = to.camera.ImgFromCam(to.cam_from_world * points[i]->point_in_world);
      if (!seen || !to.camera.Contains(*seen)) continue;
      const Eigen::Vector2d noise(rng.Normal(), rng.Normal());
      matches.push_back({a, b, pixels[i], *seen + noise_px * noise});
    }
    return matches;
  }

  std::vector<ReferenceMatch> MatchAll(int count_per_pair, double noise_px, Rng& rng) const {
    std::vector<ReferenceMatch> matches;
    const int n = static_cast<int>(references.size());
    for (int a = 0; a < n; ++a) {
      for (int b = 0; b < n; ++b) {
        if (a == b) continue;
        const auto pair = Match(a, b, count_per_pair, noise_px, rng);
        matches.insert(matches.end(), pair.begin(), pair.end());
      }
    }
    return matches;
  }
};

}  // namespace raylift
