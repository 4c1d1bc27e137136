#include "estimation/methods/methods.h"

namespace raylift {

// Sec. 3 of the paper: in every iteration P3P and E5+1 draw one sample each, all poses are scored
// on both match sets (Eqs. 1 to 5), and a new best is optimized locally: over both sets (hybrid),
// or over the set that it was drawn from (split).
//
// Beyond the paper, two 2D-3D matches are drawn as well where the position or gravity is known, and
// D3+1 draws where the joint refinement can use its poses.
RansacMethod AdaptiveMethod(const EstimatorOptions& options) {
  const bool is_split = options.local_optimization == LocalOptimization::kSplit;
  const MatchSets after_2d3d = is_split ? MatchSets::k2D3D : MatchSets::kBoth;
  const MatchSets after_2d2d = is_split ? MatchSets::k2D2D : MatchSets::kBoth;
  RansacMethod method = {.samplers = {{Solver::kP3p, after_2d3d},
                                      {Solver::kKnownCenter, after_2d3d},
                                      {Solver::kUpright, after_2d3d},
                                      {Solver::kE5p1, after_2d2d}},
                         .schedule = SolverSchedule::kAll,
                         .scored = MatchSets::kBoth,
                         .score = options.score};
  if (UsesSceneNoise(options)) method.samplers.push_back({Solver::kD3p1, MatchSets::kBoth});
  return method;
}

}  // namespace raylift
