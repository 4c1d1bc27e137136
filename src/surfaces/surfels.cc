#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>
#include <utility>

#include "base/statistics.h"
#include "surfaces/neighbor_tree.h"
#include "surfaces/raw_mesh.h"
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/surfaces/point_cloud.h"

namespace raylift {
namespace {

constexpr size_t kPointsPerTask = 4096;

// The points around determine a plane if they spread across it in both directions: in the narrower
// one by more than this share of the wider one's variance, which float coordinates round.
constexpr double kNoSpread = 1e-10;

using Neighbor = NeighborTree::Neighbor;
using Neighbors = std::span<const Neighbor>;

// Holds the neighbors of a point, relative to it.
class Neighborhood {
 public:
  void Set(const NeighborTree& tree, size_t i, Neighbors neighbors) {
    offsets_.assign(1, Eigen::Vector3d::Zero());
    for (const Neighbor& neighbor : neighbors) {
      offsets_.push_back((tree.point(neighbor.point) - tree.point(i)).cast<double>());
    }
    mean_ = std::accumulate(offsets_.begin(), offsets_.end(), Eigen::Vector3d(0, 0, 0)) / count();
    covariance_.setZero();
    for (const Eigen::Vector3d& offset : offsets_) {
      covariance_ += (offset - mean_) * (offset - mean_).transpose() / count();
    }
  }

  // Returns the normal of the plane that fits all of them best; nullopt if they lie on a line.
  std::optional<Eigen::Vector3d> Normal() const {
    if (offsets_.size() < 3) return std::nullopt;
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
    solver.computeDirect(covariance_);
    const Eigen::Vector3d variances = solver.eigenvalues();
    if (!(variances[1] > kNoSpread * variances[2])) return std::nullopt;
    return solver.eigenvectors().col(0);
  }

  // Returns the height of the mean above the point.
  double HeightAlong(const Eigen::Vector3d& normal) const { return mean_.dot(normal); }

  // Returns the variance of the points' distances from their plane, which fits three of them.
  double VarianceAlong(const Eigen::Vector3d& normal) const {
    const double variance = std::max(normal.dot(covariance_ * normal), 0.0);
    return variance * count() / std::max(count() - 3, 1.0);
  }

  double MeanSquaredDistance() const { return covariance_.trace() + mean_.squaredNorm(); }

 private:
  double count() const { return static_cast<double>(offsets_.size()); }

  std::vector<Eigen::Vector3d> offsets_;
  Eigen::Vector3d mean_;
  Eigen::Matrix3d covariance_;
};

// Makes a disc of each point of a tree.
class DiscMaker {
 public:
  DiscMaker(const NeighborTree& tree, std::span<const Eigen::Vector3f> normals,
            const SurfelOptions& options, Surfels& surfels)
      : tree_(tree), given_normals_(normals), options_(options), surfels_(surfels) {}

  void MakeAll() {
    surfels_.discs.resize(tree_.size());
    surfels_.normals.reserve(tree_.size() + 1);  // RayCaster then needs no copy
    surfels_.normals.resize(tree_.size());
    surfels_.sigmas.resize(tree_.size());
    ForEachChunk([this](size_t begin, size_t end, std::span<Neighbor> room) {
      Neighborhood around;
      for (size_t i = begin; i < end; ++i) {
        around.Set(tree_, i, tree_.Nearest(i, room));
        Place(i, around);
      }
    });
    std::vector<float> own(tree_.size());
    for (size_t i = 0; i < own.size(); ++i) own[i] = surfels_.discs[i].w();
    ForEachChunk([&](size_t begin, size_t end, std::span<Neighbor> room) {
      std::vector<float> radii;
      for (size_t i = begin; i < end; ++i) {
        if (!(own[i] > 0)) continue;
        surfels_.discs[i].w() = options_.radius
                                    ? static_cast<float>(*options_.radius)
                                    : MedianRadius(own, i, tree_.Nearest(i, room), radii);
      }
    });
  }

 private:
  template <typename Body>
  void ForEachChunk(const Body& body) const {
    ParallelForParts(tree_.size(), kPointsPerTask, options_.threads, [&](size_t begin, size_t end) {
      std::vector<Neighbor> room(static_cast<size_t>(options_.neighbors));
      body(begin, end, room);
    });
  }

  // Sets the disc of a point; no radius means no disc.
  void Place(size_t i, const Neighborhood& around) {
    surfels_.discs[i].setZero();
    const auto normal = NormalOf(i, around);
    if (!normal) return;
    const double radius = std::sqrt(2 * around.MeanSquaredDistance());
    surfels_.discs[i].head<3>() =
        tree_.point(i) + (around.HeightAlong(*normal) * *normal).cast<float>();
    surfels_.discs[i].w() = static_cast<float>(radius);
    surfels_.normals[i] = normal->cast<float>();
    surfels_.sigmas[i] = static_cast<float>(std::sqrt(around.VarianceAlong(*normal)));
  }

  std::optional<Eigen::Vector3d> NormalOf(size_t i, const Neighborhood& around) const {
    if (!given_normals_.empty()) {
      const Eigen::Vector3d given = given_normals_[tree_.IndexOf(i)].cast<double>();
      if (given.allFinite() && given.norm() > 0) return given.normalized();
    }
    return around.Normal();
  }

  // A point apart from all others, and one at an edge, has its neighbors further off than they
  // have theirs: the median of their radii is the surface's.
  static float MedianRadius(std::span<const float> own, size_t i, Neighbors neighbors,
                            std::vector<float>& radii) {
    radii.assign(1, own[i]);
    for (const Neighbor& neighbor : neighbors) {
      if (own[neighbor.point] > 0) radii.push_back(own[neighbor.point]);
    }
    return UpperMedianInPlace(std::span(radii));
  }

  const NeighborTree& tree_;
  std::span<const Eigen::Vector3f> given_normals_;
  const SurfelOptions& options_;
  Surfels& surfels_;
};

// Keeps what has a radius.
void DropEmpty(Surfels& surfels) {
  size_t kept = 0;
  for (size_t i = 0; i < surfels.discs.size(); ++i) {
    if (!(surfels.discs[i].w() > 0)) continue;
    surfels.discs[kept] = surfels.discs[i];
    surfels.normals[kept] = surfels.normals[i];
    surfels.sigmas[kept] = surfels.sigmas[i];
    if (!surfels.colors_rgb.empty()) surfels.colors_rgb[kept] = surfels.colors_rgb[i];
    ++kept;
  }
  const size_t dropped = surfels.discs.size() - kept;
  if (dropped == 0) return;
  surfels.warnings.push_back(
      fmt::format("{} of {} points left out: with their neighbors, they lie on a line or at one "
                  "place, and span no surface",
                  dropped, surfels.discs.size()));
  surfels.discs.resize(kept);
  surfels.normals.resize(kept);
  surfels.sigmas.resize(kept);
  if (!surfels.colors_rgb.empty()) surfels.colors_rgb.resize(kept);
}

}  // namespace

size_t Surfels::MemoryBytes() const {
  return discs.size() * (sizeof(discs[0]) + sizeof(normals[0]) + sizeof(sigmas[0])) +
         colors_rgb.size() * sizeof(colors_rgb[0]);
}

Surfels MakeSurfels(PointCloud cloud, const SurfelOptions& options) {
  RAYLIFT_CHECK(options.neighbors >= 3);
  Surfels surfels;
  surfels.warnings = std::move(cloud.warnings);
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& point : cloud.points_in_world) box.extend(point);
  if (!box.isEmpty()) surfels.origin_in_world = ChooseMeshOrigin(box.min(), box.max());
  std::vector<Eigen::Vector3f> points;
  points.reserve(cloud.points_in_world.size());
  for (const Eigen::Vector3d& point : cloud.points_in_world) {
    points.emplace_back((point - surfels.origin_in_world).cast<float>());
  }
  std::exchange(cloud.points_in_world, {});
  const NeighborTree tree(points);
  std::exchange(points, {});

  DiscMaker(tree, cloud.normals, options, surfels).MakeAll();
  if (!cloud.colors_rgb.empty()) {
    surfels.colors_rgb.resize(tree.size());
    for (size_t i = 0; i < tree.size(); ++i) {
      surfels.colors_rgb[i] = cloud.colors_rgb[tree.IndexOf(i)];
    }
  }
  DropEmpty(surfels);
  if (surfels.discs.empty()) {
    throw InputError("point cloud: expected points of a surface, found too few or none");
  }
  return surfels;
}

}  // namespace raylift
