#include "estimation/methods/methods.h"

namespace raylift {

// LO-RANSAC on the 2D-2D matches: five to one reference, and a sixth to another for the length of
// the translation.
RansacMethod E5p1Method(const EstimatorOptions& options) {
  return {.samplers = {{Solver::kE5p1, MatchSets::k2D2D}},
          .scored = MatchSets::k2D2D,
          .score = options.score};
}

}  // namespace raylift
