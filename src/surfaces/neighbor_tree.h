// Finds the nearest neighbors of points by a balanced k-d tree, for clouds of millions of points
// whose density varies.

#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace raylift {

class NeighborTree {
 public:
  struct Neighbor {
    float squared_distance;
    uint32_t point;
  };

  // Takes the points in an order of its own, in which close ones follow each other. The same for
  // any number of threads.
  NeighborTree(std::span<const Eigen::Vector3f> points, int threads);

  size_t size() const { return items_.size(); }
  const Eigen::Vector3f& point(size_t i) const { return items_[i].point; }
  // Returns the index among the points given to the constructor.
  uint32_t IndexOf(size_t i) const { return items_[i].index; }

  // Finds the points nearest to point i, nearest first: as many as `neighbors` has room for, as far
  // as there are. Those at one place count as one, those at the place of point i not at all.
  // Returns those that were found.
  std::span<const Neighbor> Nearest(size_t i, std::span<Neighbor> neighbors) const;

 private:
  struct Item {
    Eigen::Vector3f point;
    uint32_t index;
  };
  struct Split {
    float at;
    int axis;
  };
  struct Range {
    size_t begin, end;
  };
  class Search;

  Range RangeOf(size_t node, int level) const;
  void SplitRange(const Range& range, Split& split);

  std::vector<Item> items_;
  std::vector<Split> splits_;  // of the inner nodes, level by level
  int num_levels_ = 0;         // of inner nodes
};

}  // namespace raylift
