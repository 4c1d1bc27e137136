#include "estimation/local_optimization.h"

#include <algorithm>

#include "estimation/pose_minimizer.h"

namespace raylift {
namespace {

// No more matches than these of each kind are needed to come as near as the score can tell; the
// final refinement takes all. Blocks are in random order.
constexpr size_t kBlocksToReach = 24;
constexpr size_t kBlocksToSettle = 32;

ActiveMatches<float> FirstBlocks(ActiveMatches<float> matches, size_t count) {
  matches.point_blocks = matches.point_blocks.first(std::min(matches.point_blocks.size(), count));
  matches.pair_blocks = matches.pair_blocks.first(std::min(matches.pair_blocks.size(), count));
  return matches;
}

}  // namespace

SolverPose OptimizeLocally(const PreparedProblem& problem, const SolverPose& pose,
                           ResidualKinds kinds, int max_steps) {
  ActiveMatches<float> active;
  if (kinds.points) {
    active.point_blocks = problem.point_blocks;
  }
  if (kinds.pairs) {
    active.pair_blocks = problem.pair_blocks;
    active.pair_block_reference = problem.pair_block_reference;
  }
  // A minimal sample's pose may be so far off that many inliers lie beyond the threshold: first
  // reach for those, then settle on the score's own cost.
  KindWeights wide;
  wide.point_loss.limit = wide.pair_loss.limit = kNearSquared;
  const SolverPose near =
      Minimize(problem, FirstBlocks(active, kBlocksToReach), pose, wide, 2, 1e-2);
  return Minimize(problem, FirstBlocks(active, kBlocksToSettle), near, KindWeights{}, max_steps,
                  1e-4);
}

}  // namespace raylift
