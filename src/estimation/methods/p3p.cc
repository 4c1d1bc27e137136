#include "estimation/methods/methods.h"

namespace raylift {

// LO-RANSAC on the 2D-3D matches. Two of them are enough where the position or gravity is known.
RansacMethod P3pMethod(const EstimatorOptions& options) {
  return {.samplers = {{Solver::kP3p, MatchSets::k2D3D},
                       {Solver::kKnownCenter, MatchSets::k2D3D},
                       {Solver::kUpright, MatchSets::k2D3D}},
          .scored = MatchSets::k2D3D,
          .score = options.score};
}

}  // namespace raylift
