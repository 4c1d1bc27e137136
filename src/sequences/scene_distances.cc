#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "base/index_sets.h"
#include "base/statistics.h"
#include "lifting/source_view.h"

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/sequences/smooth_queries.h"

namespace raylift {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kColumns = 8, kRows = 6;  // grid of pixels per reference
constexpr size_t kNearest = 20;         // nearest references

// Returns the points that the pixels show; empty where the geometry cannot be read: localization
// reports that where it needs it.
std::vector<Vector3d> PointsIn(const GeometrySource& source, const PosedImage& reference,
                               std::span<const Vector2d> pixels) {
  std::vector<Vector3d> points;
  try {
    for (const auto& point : source.Lift(reference, pixels)) {
      if (point) points.push_back(point->point_in_world);
    }
  } catch (const InputError&) {
  }
  return points;
}

}  // namespace

SceneDistances::SceneDistances(const Scene& scene, int threads)
    : seen_(scene.references.images.size()) {
  const auto sources = scene.Geometry();
  ParallelFor(seen_.size(), threads, [&](size_t i) {
    const PosedImage& reference = scene.references.images[i];
    seen_[i].center = reference.cam_from_world.OriginInSource();
    const std::vector<Vector2d> pixels = PixelGrid(reference.camera, kColumns, kRows);
    for (const auto& source : sources) {
      seen_[i].points = PointsIn(*source, reference, pixels);
      if (!seen_[i].points.empty()) break;
    }
  });
  std::erase_if(seen_, [](const Seen& seen) { return seen.points.empty(); });
}

std::optional<double> SceneDistances::At(const Camera& camera, const Rigid3& cam_from_world) const {
  const Vector3d center = cam_from_world.OriginInSource();
  std::vector<std::pair<double, size_t>> others;
  for (size_t i = 0; i < seen_.size(); ++i) {
    others.emplace_back((seen_[i].center - center).squaredNorm(), i);
  }
  std::vector<double> distances;
  for (const size_t near : Nearest(std::move(others), kNearest)) {
    for (const Vector3d& point : seen_[near].points) {
      const auto pixel = camera.ImgFromCam(cam_from_world * point);
      if (pixel && camera.Contains(*pixel)) distances.push_back((point - center).norm());
    }
  }
  if (distances.empty()) return std::nullopt;
  return UpperMedianInPlace(std::span(distances));
}

}  // namespace raylift
