// The nearest neighbors of points, by nanoflann's k-d tree, for clouds of millions of points whose
// density varies.

#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "surfaces/space_order.h"
#include <Eigen/Core>
#include <nanoflann.hpp>

#include "raylift/base/parallel.h"

namespace raylift {

class NeighborTree {
 public:
  struct Neighbor {
    double squared_distance;
    uint32_t point;
  };

  // Takes the points in an order of its own, in which close ones follow each other: searches in
  // this order take a fifth of the time that those in a random one take.
  explicit NeighborTree(const std::vector<Eigen::Vector3f>& points)
      : order_(OrderInSpace(points, 21)), points_(points, order_), tree_(3, points_) {
    points_.watch = nullptr;  // any thread searches
  }

  size_t size() const { return points_.size(); }
  const Eigen::Vector3f& point(size_t i) const { return points_[i]; }
  // Returns the index among the points given to the constructor.
  uint32_t IndexOf(size_t i) const { return order_[i]; }

  // Returns the points nearest to point i, nearest first, in the front of `neighbors`: as many as
  // that has room for, or all where they are fewer. Points at one place count as one, and those at
  // the place of point i do not count.
  std::span<const Neighbor> Nearest(size_t i, std::span<Neighbor> neighbors) const {
    if (neighbors.empty()) return {};
    const Eigen::Vector3d query = point(i).cast<double>();
    Found found{*this, neighbors};
    tree_.findNeighbors(found, query.data(), {});
    return neighbors.first(found.count);
  }

 private:
  // Gives nanoflann the points in double, as it sums up how far boxes of points are, and what float
  // rounds there would leave out points that are nearer.
  struct Points : std::vector<Eigen::Vector3f> {
    Points(std::span<const Eigen::Vector3f> points, std::span<const uint32_t> order) {
      reserve(order.size());
      for (const uint32_t i : order) push_back(points[i]);
    }
    size_t kdtree_get_point_count() const { return size(); }
    double kdtree_get_pt(size_t i, int axis) const {
      if (watch != nullptr && ++asked % (1 << 16) == 0) watch->Check();
      return double{(*this)[i][axis]};
    }
    bool kdtree_get_bbox(const auto& /*box*/) const { return false; }  // to be computed

    CallWatch* watch = CallWatch::Current();  // ends the making of the tree
    mutable unsigned asked = 0;
  };

  // Holds what nanoflann has found so far, sorted, as it is short.
  struct Found {
    using DistanceType = double;
    using IndexType = uint32_t;

    const NeighborTree& tree;
    const std::span<Neighbor> room;
    size_t count = 0;

    bool full() const { return count == room.size(); }
    void sort() const {}
    double worstDist() const {
      return full() ? room.back().squared_distance : std::numeric_limits<double>::infinity();
    }
    bool addPoint(double squared_distance, uint32_t i) {
      if (!(squared_distance < worstDist()) || squared_distance == 0) return true;
      size_t place = count;
      while (place > 0 && room[place - 1].squared_distance > squared_distance) --place;
      for (size_t k = place; k > 0 && room[k - 1].squared_distance == squared_distance; --k) {
        if (tree.point(room[k - 1].point) == tree.point(i)) return true;
      }
      if (!full()) ++count;
      for (size_t k = count - 1; k > place; --k) room[k] = room[k - 1];
      room[place] = {squared_distance, i};
      return true;  // go on
    }
  };

  std::vector<uint32_t> order_;
  Points points_;
  nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Points>, Points, 3,
                                      uint32_t>
      tree_;
};

}  // namespace raylift
