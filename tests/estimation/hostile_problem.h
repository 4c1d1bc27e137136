// Random problems and options that nobody wrote an estimator for: scenes seen right or wrong, most
// of them tiny or degenerate, in which numbers and indices are then replaced by what should not be
// there.

#pragma once

#include "base/rng.h"

#include "raylift/estimation/options.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct HostileProblem {
  PoseProblem problem;
  EstimatorOptions options;  // valid ones
};

HostileProblem MakeHostileProblem(Rng& rng);

}  // namespace raylift
