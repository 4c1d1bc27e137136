// How far points are from a surface, be it triangles or a cloud of points: accuracy and
// completeness of reconstructions (Knapitsch et al., "Tanks and Temples", 2017).

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <unordered_set>
#include <vector>

#include <Eigen/Geometry>

#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

// Finds the nearest of many triangles (or points) by a tree of bounding boxes. In double
// throughout.
class SurfaceTree {
 public:
  explicit SurfaceTree(const TriangleMesh& mesh);
  explicit SurfaceTree(std::span<const Eigen::Vector3d> points);

  bool empty() const { return nodes_.empty(); }
  // The distance to the nearest triangle or point, or `max_distance` where that is nearer. Thread
  // safe.
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
  double SquaredDistance(const Triangle& triangle, const Eigen::Vector3d& point) const;

  std::vector<Eigen::Vector3d> corners_;
  std::vector<Triangle> triangles_;
  std::vector<Node> nodes_;
};

// The squared distance of a point to a triangle, which may be a segment or a point (Ericson,
// "Real-Time Collision Detection", 5.1.5).
double SquaredDistanceToTriangle(const Eigen::Vector3d& point, const Eigen::Vector3d& a,
                                 const Eigen::Vector3d& b, const Eigen::Vector3d& c);

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

}  // namespace raylift
