#include "estimation/methods/methods.h"

namespace raylift {

// LO-RANSAC on the 2D-2D matches, drawing three lifted ones of a reference whose depths may have
// any scale, and a fourth of another reference for the length of the translation. The joint
// refinement then uses the depths, too, as it estimates what they are worth.
RansacMethod D3p1Method(const EstimatorOptions& options) {
  return {.samplers = {{Solver::kD3p1, MatchSets::k2D2D}},
          .scored = MatchSets::k2D2D,
          .score = options.score,
          .refined = UsesSceneNoise(options) ? MatchSets::kBoth : MatchSets::k2D2D};
}

}  // namespace raylift
