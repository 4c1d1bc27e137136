#include "estimation/covisibility.h"

#include <optional>

#include "base/index_sets.h"

#include "raylift/scene/keypoints.h"

namespace raylift {
std::vector<int> ClusterBySharedKeypoints(const PoseProblem& problem) {
  const size_t count = problem.references.size();
  DisjointSets sets(count);
  const KeypointNumbers keypoints = NumberQueryKeypoints(problem.matches_2d2d, {});
  std::vector<std::optional<size_t>> reference_of_keypoint(keypoints.count);
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    const int index = problem.matches_2d2d[i].reference;
    if (index < 0 || static_cast<size_t>(index) >= count) {
      continue;
    }
    const auto reference = static_cast<size_t>(index);
    std::optional<size_t>& first = reference_of_keypoint[keypoints.of_2d2d[i]];
    if (first) {
      sets.Join(*first, reference);
    } else {
      first = reference;
    }
  }
  return sets.Numbers();
}

}  // namespace raylift
