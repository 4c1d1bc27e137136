#include "estimation/covisibility.h"

#include <map>
#include <utility>

#include "raylift/base/disjoint_sets.h"

namespace raylift {
std::vector<int> ClusterBySharedKeypoints(const PoseProblem& problem) {
  const size_t count = problem.references.size();
  DisjointSets sets(count);
  std::map<std::pair<double, double>, size_t> reference_of_keypoint;
  for (const Match2D2D& match : problem.matches_2d2d) {
    if (match.reference < 0 || static_cast<size_t>(match.reference) >= count) {
      continue;
    }
    const auto [entry, is_new] = reference_of_keypoint.try_emplace(
        {match.query_px.x(), match.query_px.y()}, static_cast<size_t>(match.reference));
    if (!is_new) {
      sets.Join(entry->second, static_cast<size_t>(match.reference));
    }
  }
  return sets.Numbers();
}

}  // namespace raylift
