#include "surfaces/neighbor_tree.h"

#include <algorithm>

#include <Eigen/Geometry>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr size_t kLeafSize = 16;

}  // namespace

NeighborTree::NeighborTree(std::span<const Eigen::Vector3f> points, int threads)
    : items_(points.size()) {
  for (size_t i = 0; i < points.size(); ++i) items_[i] = {points[i], static_cast<uint32_t>(i)};
  while (points.size() >> num_levels_ > kLeafSize) ++num_levels_;
  splits_.resize((size_t{1} << num_levels_) - 1);
  for (int level = 0; level < num_levels_; ++level) {
    const size_t first = (size_t{1} << level) - 1;
    ParallelFor(size_t{1} << level, threads,
                [&](size_t node) { SplitRange(RangeOf(node, level), splits_[first + node]); });
  }
}

// Returns the range of the points below a node (counted within its level): the whole range, halved
// at each level.
NeighborTree::Range NeighborTree::RangeOf(size_t node, int level) const {
  Range range{0, items_.size()};
  for (int bit = level - 1; bit >= 0; --bit) {
    const size_t middle = range.begin + (range.end - range.begin) / 2;
    (node >> bit & 1u ? range.begin : range.end) = middle;
  }
  return range;
}

void NeighborTree::SplitRange(const Range& range, Split& split) {
  Eigen::AlignedBox3f box;
  for (size_t i = range.begin; i < range.end; ++i) box.extend(items_[i].point);
  box.sizes().maxCoeff(&split.axis);
  const auto at = [this](size_t i) { return items_.begin() + static_cast<ptrdiff_t>(i); };
  const size_t middle = range.begin + (range.end - range.begin) / 2;
  std::nth_element(at(range.begin), at(middle), at(range.end),
                   [axis = split.axis](const Item& a, const Item& b) {
                     return std::pair(a.point[axis], a.index) < std::pair(b.point[axis], b.index);
                   });
  split.at = items_[middle].point[split.axis];
}

// A search; `found_` is kept sorted, as it is short.
class NeighborTree::Search {
 public:
  Search(const NeighborTree& tree, size_t query, std::span<Neighbor> found)
      : tree_(tree), query_(tree.items_[query].point), found_(found) {}

  size_t Run() {
    Visit(0, 0, {0, tree_.items_.size()}, Eigen::Vector3f::Zero());
    return count_;
  }

 private:
  float Reach() const {
    return count_ < found_.size() ? std::numeric_limits<float>::infinity()
                                  : found_.back().squared_distance;
  }

  // `outside`: how far the query is out of the node's box along each axis.
  void Visit(size_t node, int level, const Range& range, const Eigen::Vector3f& outside) {
    if (level == tree_.num_levels_) {
      for (size_t i = range.begin; i < range.end; ++i) Consider(i);
      return;
    }
    const Split& split = tree_.splits_[(size_t{1} << level) - 1 + node];
    const size_t middle = range.begin + (range.end - range.begin) / 2;
    const float beyond = query_[split.axis] - split.at;
    const Range low{range.begin, middle};
    const Range high{middle, range.end};
    const size_t low_node = 2 * node;
    const bool is_low = beyond < 0;
    Visit(low_node + (is_low ? 0 : 1), level + 1, is_low ? low : high, outside);
    Eigen::Vector3f other = outside;
    other[split.axis] = beyond;
    if (other.squaredNorm() < Reach()) {
      Visit(low_node + (is_low ? 1 : 0), level + 1, is_low ? high : low, other);
    }
  }

  void Consider(size_t i) {
    const float squared_distance = (tree_.items_[i].point - query_).squaredNorm();
    if (!(squared_distance < Reach()) || squared_distance == 0) return;
    size_t place = count_;
    while (place > 0 && found_[place - 1].squared_distance > squared_distance) --place;
    for (size_t k = place; k > 0 && found_[k - 1].squared_distance == squared_distance; --k) {
      if (tree_.point(found_[k - 1].point) == tree_.point(i)) return;
    }
    count_ = std::min(count_ + 1, found_.size());
    for (size_t k = count_ - 1; k > place; --k) found_[k] = found_[k - 1];
    found_[place] = {squared_distance, static_cast<uint32_t>(i)};
  }

  const NeighborTree& tree_;
  const Eigen::Vector3f query_;
  const std::span<Neighbor> found_;
  size_t count_ = 0;
};

std::span<const NeighborTree::Neighbor> NeighborTree::Nearest(size_t i,
                                                              std::span<Neighbor> neighbors) const {
  return neighbors.first(neighbors.empty() ? 0 : Search(*this, i, neighbors).Run());
}

}  // namespace raylift
