#include "estimation/ransac/local_optimization.h"

#include <algorithm>
#include <limits>

#include "estimation/refinement/pose_minimizer.h"

namespace raylift {
namespace {

// No more matches than these of each set are needed to come as near as the score can tell; the
// final refinement takes all. Blocks are in random order.
constexpr size_t kBlocksToReach = 24;
constexpr size_t kBlocksToSettle = 32;

// The first blocks of each set, and the weights with which they stand for all.
struct BlockSample {
  ActiveMatches<float> matches;
  MatchSetWeights weights;

  BlockSample(const ActiveMatches<float>& all, size_t count, double loss_limit) : matches(all) {
    matches.blocks_2d3d = all.blocks_2d3d.first(std::min(all.blocks_2d3d.size(), count));
    matches.blocks_2d2d = all.blocks_2d2d.first(std::min(all.blocks_2d2d.size(), count));
    weights.weight_2d3d = Share(all.blocks_2d3d.size(), matches.blocks_2d3d.size());
    weights.weight_2d2d = Share(all.blocks_2d2d.size(), matches.blocks_2d2d.size());
    weights.loss_2d3d.limit = weights.loss_2d2d.limit = loss_limit;
  }

  CamFromLocal Minimized(const NormalizedProblem& problem, const CamFromLocal& start, int max_steps,
                         double relative_tolerance) const {
    return Minimize(problem, matches, start, weights, max_steps, relative_tolerance);
  }

 private:
  static double Share(size_t all, size_t used) {
    return used == 0 ? 1 : static_cast<double>(all) / static_cast<double>(used);
  }
};

}  // namespace

CamFromLocal OptimizeLocally(const NormalizedProblem& problem, const CamFromLocal& pose,
                             MatchSets sets, int max_steps, OptimizedMatches matches) {
  ActiveMatches<float> active;
  if (Has2D3D(sets)) {
    active.blocks_2d3d = problem.blocks_2d3d;
    active.block_camera_2d3d = problem.block_camera_2d3d;
  }
  if (Has2D2D(sets)) {
    active.blocks_2d2d = problem.blocks_2d2d;
    active.block_camera_reference_2d2d = problem.block_camera_reference_2d2d;
  }
  const auto sample = [&](size_t count, double loss_limit) {
    const bool all = matches == OptimizedMatches::kAll;
    return BlockSample(active, all ? std::numeric_limits<size_t>::max() : count, loss_limit);
  };
  // A minimal sample's pose may be so far off that many inliers lie beyond the threshold: first
  // reach for those, then settle on the score's own cost.
  const CamFromLocal near = sample(kBlocksToReach, kNearSquared).Minimized(problem, pose, 2, 1e-2);
  return sample(kBlocksToSettle, 1).Minimized(problem, near, max_steps, 1e-4);
}

}  // namespace raylift
