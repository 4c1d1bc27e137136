// Computes distances of points from a surface, of triangles or of a cloud of points: accuracy and
// completeness of reconstructions (Knapitsch et al., "Tanks and Temples", 2017).

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <unordered_set>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "raylift/evaluation/depth_errors.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

// Finds the nearest of many triangles (or points) by a tree of bounding boxes, in double
// throughout.
class SurfaceTree {
 public:
  explicit SurfaceTree(const TriangleMesh& mesh);
  explicit SurfaceTree(std::span<const Eigen::Vector3d> points);

  bool empty() const { return nodes_.empty(); }
  // Returns the distance to the nearest triangle or point, or `max_distance` where that is nearer.
  // Thread safe.
  double Distance(const Eigen::Vector3d& point, double max_distance) const;

 private:
  using Triangle = std::array<uint32_t, 3>;  // indices of corners_
  struct Node {
    Eigen::AlignedBox3d box;
    uint32_t first =
        0;  // of `count` triangles; of an inner node: its right child, the left is next
    uint32_t count = 0;  // 0: an inner node
  };

  void Build();
  void BuildNode(size_t begin, size_t end, std::vector<Eigen::Vector3d>& centers);

  std::vector<Eigen::Vector3d> corners_;
  std::vector<Triangle> triangles_;
  std::vector<Node> nodes_;
};

// Keeps the first point of each cell of a grid, so that what many images show counts once. Where
// the points become more than `max_points`, a random half of all cells is given up, seen or not:
// the others remain a fair sample, and memory is bounded.
class ThinnedCloud {
 public:
  ThinnedCloud(double cell_size, size_t max_points);

  void Add(std::span<const Eigen::Vector3d> points);
  const std::vector<Eigen::Vector3d>& points() const { return points_; }

 private:
  void GiveUpHalf();

  double cell_size_;
  size_t max_points_;
  uint64_t largest_cell_ = ~uint64_t{0};  // cells of larger hashes are given up
  std::unordered_set<uint64_t> cells_;    // by hashes: two of 64 bits hardly ever agree
  std::vector<uint64_t> cell_of_point_;
  std::vector<Eigen::Vector3d> points_;
};

// Scores accuracy and completeness of several sources against a mesh, image by image: memory holds
// a limited number of points of each, whatever the number of images and the size of the surface.

class SurfaceScorer {
 public:
  // `thresholds` ascend. Completeness is measured on what `views` see of the truth.
  SurfaceScorer(const TriangleMesh& mesh, const GeometrySource& truth,
                std::span<const PosedImage> views, size_t num_sources,
                std::span<const double> thresholds, int threads);

  // Adds what every source shows to the next view, in world coordinates; the truth's entry is
  // ignored.
  void Add(std::span<const std::vector<Eigen::Vector3d>> points_of_source, size_t truth);

  // Returns one score for each threshold; an empty list for a source without points.
  std::vector<SurfaceScore> Score(size_t source) const;

 private:
  struct OfSource {
    explicit OfSource(double cell_size);
    ThinnedCloud cloud;
    std::vector<float> from_truth;  // of each of samples_, to the nearest point so far
  };

  std::vector<double> thresholds_;
  int threads_;
  SurfaceTree surface_;
  std::vector<Eigen::Vector3d> samples_;  // of the truth
  std::vector<OfSource> sources_;
};

// Returns the pixel centers, every few pixels, that surfaces are scored by.
std::vector<Eigen::Vector2d> ScoredPixels(const Camera& camera);

}  // namespace raylift
