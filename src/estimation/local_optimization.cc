#include "estimation/local_optimization.h"

#include <algorithm>
#include <limits>

#include "estimation/pose_minimizer.h"

namespace raylift {
namespace {

// No more matches than these of each kind are needed to come as near as the score can tell; the
// final refinement takes all. Blocks are in random order.
constexpr size_t kBlocksToReach = 24;
constexpr size_t kBlocksToSettle = 32;

// The first blocks of each kind, and the weights with which they stand for all.
struct Part {
  ActiveMatches<float> matches;
  KindWeights weights;

  Part(const ActiveMatches<float>& all, size_t count, double loss_limit) : matches(all) {
    matches.point_blocks = all.point_blocks.first(std::min(all.point_blocks.size(), count));
    matches.pair_blocks = all.pair_blocks.first(std::min(all.pair_blocks.size(), count));
    weights.point_weight = Share(all.point_blocks.size(), matches.point_blocks.size());
    weights.pair_weight = Share(all.pair_blocks.size(), matches.pair_blocks.size());
    weights.point_loss.limit = weights.pair_loss.limit = loss_limit;
  }

  SolverPose Minimized(const PreparedProblem& problem, const SolverPose& start, int max_steps,
                       double relative_tolerance) const {
    return Minimize(problem, matches, start, weights, max_steps, relative_tolerance);
  }

 private:
  static double Share(size_t all, size_t used) {
    return used == 0 ? 1 : static_cast<double>(all) / static_cast<double>(used);
  }
};

}  // namespace

SolverPose OptimizeLocally(const PreparedProblem& problem, const SolverPose& pose,
                           ResidualKinds kinds, int max_steps, OptimizedMatches matches) {
  ActiveMatches<float> active;
  if (kinds.points) {
    active.point_blocks = problem.point_blocks;
    active.point_block_camera = problem.point_block_camera;
  }
  if (kinds.pairs) {
    active.pair_blocks = problem.pair_blocks;
    active.pair_block_view = problem.pair_block_view;
  }
  const auto part = [&](size_t count, double loss_limit) {
    const bool all = matches == OptimizedMatches::kAll;
    return Part(active, all ? std::numeric_limits<size_t>::max() : count, loss_limit);
  };
  // A minimal sample's pose may be so far off that many inliers lie beyond the threshold: first
  // reach for those, then settle on the score's own cost.
  const SolverPose near = part(kBlocksToReach, kNearSquared).Minimized(problem, pose, 2, 1e-2);
  return part(kBlocksToSettle, 1).Minimized(problem, near, max_steps, 1e-4);
}

}  // namespace raylift
