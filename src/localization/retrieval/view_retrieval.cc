// Retrieves by cameras: finds the references that look at the same part of the scene as a query.

#include <algorithm>
#include <cmath>
#include <numbers>

#include "lifting/source_view.h"
#include "localization/retrieval/retrieval.h"

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

// The grid of an image's pixels, spread evenly, whose rays are cast.
constexpr int kGridColumns = 16;
constexpr int kGridRows = 12;
// The number of distances on each ray of a frustum; neighbors have equal ratios.
constexpr int kRangeSteps = 5;
// A surface point is seen where the ray at it ends so near, relative to its distance.
constexpr double kSamePlace = 1e-3;

// A camera with its values that every point needs.
struct Eye {
  explicit Eye(const PosedImage& posed)
      : image(&posed),
        rotation(posed.cam_from_world.rotation.toRotationMatrix()),
        translation(posed.cam_from_world.translation),
        center(posed.cam_from_world.OriginInSource()) {}

  bool Sees(const Eigen::Vector3d& point_in_world) const {
    const auto pixel = image->camera.ImgFromCam(rotation * point_in_world + translation);
    return pixel && image->camera.Contains(*pixel);
  }
  Eigen::Vector3d OpticalAxis() const { return rotation.row(2); }

  const PosedImage* image;
  Eigen::Matrix3d rotation;  // cam_from_world
  Eigen::Vector3d translation;
  Eigen::Vector3d center;
};

std::vector<Eye> EyesOf(std::span<const PosedImage> images) {
  std::vector<Eye> eyes;
  eyes.reserve(images.size());
  for (const PosedImage& image : images) eyes.emplace_back(image);
  return eyes;
}

// Returns unit directions of the grid's pixels; those without a ray are left out.
std::vector<Eigen::Vector3d> RaysInWorld(const Eye& eye) {
  std::vector<Eigen::Vector3d> rays;
  for (const Eigen::Vector2d& pixel : PixelGrid(eye.image->camera, kGridColumns, kGridRows)) {
    const auto ray = eye.image->camera.RayInCam(pixel);
    if (ray) rays.push_back(eye.rotation.transpose() * *ray);
  }
  return rays;
}

double Share(size_t count, size_t total) {
  return static_cast<double>(count) / static_cast<double>(total);
}

struct VisiblePoint {
  Eigen::Vector3d point_in_world;
  Eigen::Vector3d normal_in_world;  // toward the camera that saw it
};

std::vector<VisiblePoint> PointsOnMesh(const Eye& eye, const RayCaster& mesh) {
  std::vector<Ray> rays;
  for (const Eigen::Vector3d& direction : RaysInWorld(eye)) rays.push_back({eye.center, direction});
  const auto hits = mesh.Cast(rays);
  std::vector<VisiblePoint> points;
  for (size_t i = 0; i < hits.size(); ++i) {
    if (!hits[i]) continue;
    const Eigen::Vector3d& direction = rays[i].direction_in_world;
    const Eigen::Vector3d& normal = hits[i]->normal_in_world;
    points.push_back({eye.center + hits[i]->ray_t * direction,
                      normal.dot(direction) < 0 ? normal : Eigen::Vector3d(-normal)});
  }
  return points;
}

// Returns the points in the image whose near side is turned to it: no more than these can be seen.
std::vector<Eigen::Vector3d> Candidates(const Eye& eye, std::span<const VisiblePoint> points) {
  std::vector<Eigen::Vector3d> candidates;
  for (const VisiblePoint& point : points) {
    if (point.normal_in_world.dot(eye.center - point.point_in_world) > 0 &&
        eye.Sees(point.point_in_world)) {
      candidates.push_back(point.point_in_world);
    }
  }
  return candidates;
}

size_t CountUnoccluded(const Eye& eye, std::span<const Eigen::Vector3d> points,
                       const RayCaster& mesh) {
  std::vector<Ray> rays;
  for (const Eigen::Vector3d& point : points) rays.push_back({eye.center, point - eye.center});
  size_t count = 0;
  for (const auto& hit : mesh.Cast(rays)) count += !hit || hit->ray_t > 1 - kSamePlace;
  return count;
}

// Casts rays only at references that may be among the best: no more points can be unoccluded than
// are in the image.
std::vector<RetrievedReference> MostOverlapping(const Eye& query, std::span<const Eye> references,
                                                const RayCaster& mesh, int top_k) {
  const auto points = PointsOnMesh(query, mesh);
  constexpr size_t kRays = size_t{kGridColumns} * kGridRows;
  std::vector<RetrievedReference> bounds;
  for (size_t i = 0; i < references.size(); ++i) {
    if (references[i].image->name == query.image->name) continue;
    const size_t count = Candidates(references[i], points).size();
    if (count > 0) bounds.push_back({static_cast<int>(i), Share(count, kRays)});
  }
  std::sort(bounds.begin(), bounds.end(), IsBetter);
  std::vector<RetrievedReference> best;
  for (const RetrievedReference& bound : bounds) {
    const bool full = best.size() >= static_cast<size_t>(std::max(0, top_k));
    if (full && (best.empty() || bound.score < best.back().score)) break;
    const Eye& reference = references[static_cast<size_t>(bound.reference_index)];
    const size_t seen = CountUnoccluded(reference, Candidates(reference, points), mesh);
    if (seen == 0) continue;
    const RetrievedReference found{bound.reference_index, Share(seen, kRays)};
    best.insert(std::upper_bound(best.begin(), best.end(), found, IsBetter), found);
    if (full) best.pop_back();
  }
  return best;
}

// Lists of every query from a function of the query's eye and those of the references.
template <typename Rank>
RetrievedLists RankEach(std::span<const PosedImage> queries, std::span<const PosedImage> references,
                        int threads, const Rank& rank) {
  const std::vector<Eye> eyes = EyesOf(references);
  RetrievedLists lists(queries.size());
  ParallelFor(queries.size(), threads,
              [&](size_t i) { lists[i] = rank(Eye(queries[i]), std::span<const Eye>(eyes)); });
  return lists;
}

}  // namespace

RetrievedLists RetrieveByDistance(std::span<const PosedImage> queries,
                                  std::span<const PosedImage> references, double max_angle_deg,
                                  int top_k, int threads) {
  const double min_cosine = std::cos(max_angle_deg * std::numbers::pi / 180);
  return RankEach(queries, references, threads, [&](const Eye& query, std::span<const Eye> eyes) {
    std::vector<RetrievedReference> list;
    for (size_t i = 0; i < eyes.size(); ++i) {
      if (eyes[i].image->name == query.image->name) continue;
      if (eyes[i].OpticalAxis().dot(query.OpticalAxis()) < min_cosine) continue;
      list.push_back({static_cast<int>(i), -(eyes[i].center - query.center).norm()});
    }
    KeepBest(&list, top_k);
    return list;
  });
}

RetrievedLists RetrieveByFrustum(std::span<const PosedImage> queries,
                                 std::span<const PosedImage> references, const ViewRange& range,
                                 int top_k, int threads) {
  return RankEach(queries, references, threads, [&](const Eye& query, std::span<const Eye> eyes) {
    std::vector<Eigen::Vector3d> points;
    for (const Eigen::Vector3d& ray : RaysInWorld(query)) {
      for (int step = 0; step < kRangeSteps; ++step) {
        const double distance =
            range.near * std::pow(range.far / range.near, (step + 0.5) / kRangeSteps);
        points.push_back(query.center + distance * ray);
      }
    }
    std::vector<RetrievedReference> list;
    for (size_t i = 0; i < eyes.size(); ++i) {
      if (eyes[i].image->name == query.image->name) continue;
      const auto seen = std::count_if(points.begin(), points.end(), [&](const auto& point) {
        return (point - eyes[i].center).norm() <= range.far && eyes[i].Sees(point);
      });
      if (seen == 0) continue;
      list.push_back({static_cast<int>(i), Share(static_cast<size_t>(seen), points.size())});
    }
    KeepBest(&list, top_k);
    return list;
  });
}

RetrievedLists RetrieveByOverlap(std::span<const PosedImage> queries,
                                 std::span<const PosedImage> references, const RayCaster& mesh,
                                 int top_k, int threads) {
  return RankEach(queries, references, threads, [&](const Eye& query, std::span<const Eye> eyes) {
    return MostOverlapping(query, eyes, mesh, top_k);
  });
}

}  // namespace raylift
