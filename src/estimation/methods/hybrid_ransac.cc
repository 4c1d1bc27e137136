#include "estimation/methods/methods.h"

namespace raylift {

// Camposeco et al. (CVPR 2018): each iteration first draws which solver, poses are compared by the
// sum of inliers and optimized on the 2D-3D matches.
RansacMethod HybridRansacMethod() {
  return {.samplers = {{Solver::kP3p, MatchSets::k2D3D},
                       {Solver::kKnownCenter, MatchSets::k2D3D},
                       {Solver::kUpright, MatchSets::k2D3D},
                       {Solver::kE5p1, MatchSets::k2D3D}},
          .schedule = SolverSchedule::kByProbability,
          .scored = MatchSets::kBoth,
          .score = ScoreCombination::kSumInliers};
}

}  // namespace raylift
