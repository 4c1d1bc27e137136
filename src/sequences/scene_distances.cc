#include <algorithm>
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
constexpr size_t kNearest = 20;         // nearest references that tell the distance
constexpr size_t kConsidered = 500;     // and of which some may see the same

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
    seen_[i].reference = i;
    seen_[i].center = reference.cam_from_world.OriginInSource();
    const std::vector<Vector2d> pixels = PixelGrid(reference.camera, kColumns, kRows);
    for (const auto& source : sources) {
      seen_[i].points = PointsIn(*source, reference, pixels);
      if (!seen_[i].points.empty()) break;
    }
  });
  std::erase_if(seen_, [](const Seen& seen) { return seen.points.empty(); });
}

std::vector<size_t> SceneDistances::NearestTo(const Vector3d& center, size_t most) const {
  std::vector<std::pair<double, size_t>> others;
  for (size_t i = 0; i < seen_.size(); ++i) {
    others.emplace_back((seen_[i].center - center).squaredNorm(), i);
  }
  return Nearest(std::move(others), most);
}

std::optional<double> SceneDistances::At(const Camera& camera, const Rigid3& cam_from_world) const {
  const Vector3d center = cam_from_world.OriginInSource();
  std::vector<double> distances;
  for (const size_t near : NearestTo(center, kNearest)) {
    for (const Vector3d& point : seen_[near].points) {
      const auto pixel = camera.ImgFromCam(cam_from_world * point);
      if (pixel && camera.Contains(*pixel)) distances.push_back((point - center).norm());
    }
  }
  if (distances.empty()) return std::nullopt;
  return UpperMedianInPlace(std::span(distances));
}

std::vector<size_t> SceneDistances::SeeingAlike(const Camera& camera, const Rigid3& cam_from_world,
                                                size_t most) const {
  const Vector3d center = cam_from_world.OriginInSource();
  std::vector<std::pair<double, size_t>> unlike;  // the negative sum of cosines between the rays
  for (const size_t near : NearestTo(center, kConsidered)) {
    const Seen& seen = seen_[near];
    double alike = 0;
    for (const Vector3d& point : seen.points) {
      const auto pixel = camera.ImgFromCam(cam_from_world * point);
      if (!pixel || !camera.Contains(*pixel)) continue;
      const Vector3d ray = point - center, of_reference = point - seen.center;
      alike += std::max(0.0, ray.dot(of_reference) / (ray.norm() * of_reference.norm()));
    }
    if (alike > 0) unlike.emplace_back(-alike, seen.reference);
  }
  return Nearest(std::move(unlike), most);
}

}  // namespace raylift
