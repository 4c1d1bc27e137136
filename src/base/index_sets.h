// Computes subsets of the indices of a list.

#pragma once

#include <algorithm>
#include <cstddef>
#include <map>
#include <numeric>
#include <utility>
#include <vector>

namespace raylift {

// Returns at most `most` of the indices 0, ..., count - 1, ascending and evenly spaced from 0 on.
inline std::vector<size_t> EvenlySpaced(size_t count, size_t most) {
  std::vector<size_t> chosen(std::min(count, most));
  for (size_t i = 0; i < chosen.size(); ++i) chosen[i] = i * count / chosen.size();
  return chosen;
}

// Returns the indices of at most `most` of these pairs of a distance and an index, by distance.
inline std::vector<size_t> Nearest(std::vector<std::pair<double, size_t>> pairs, size_t most) {
  std::vector<size_t> nearest(std::min(most, pairs.size()));
  std::partial_sort(pairs.begin(), pairs.begin() + static_cast<std::ptrdiff_t>(nearest.size()),
                    pairs.end());
  for (size_t i = 0; i < nearest.size(); ++i) nearest[i] = pairs[i].second;
  return nearest;
}

// Disjoint sets of indices that are joined one link at a time (union-find).
class DisjointSets {
 public:
  explicit DisjointSets(size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), size_t{0});
  }

  void Join(size_t a, size_t b) { parent_[Root(a)] = Root(b); }

  // Returns the set of each index, numbered from 0 in the order of their first members.
  std::vector<int> Numbers() {
    std::map<size_t, int> number_of_root;
    std::vector<int> numbers;
    for (size_t i = 0; i < parent_.size(); ++i) {
      const int next = static_cast<int>(number_of_root.size());
      numbers.push_back(number_of_root.try_emplace(Root(i), next).first->second);
    }
    return numbers;
  }

  // Returns whether each index is in the largest set, the first one of equally large ones.
  std::vector<bool> InLargest() {
    const std::vector<int> numbers = Numbers();
    std::map<int, size_t> sizes;
    for (const int number : numbers) ++sizes[number];
    const auto largest =
        std::max_element(sizes.begin(), sizes.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    std::vector<bool> is_in_largest;
    for (const int number : numbers) is_in_largest.push_back(number == largest->first);
    return is_in_largest;
  }

 private:
  size_t Root(size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }

  std::vector<size_t> parent_;
};

}  // namespace raylift
