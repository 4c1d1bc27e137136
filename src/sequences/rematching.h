// Localizes photographs of a walk again where the rest of the walk predicts them.

#pragma once

#include <span>
#include <string>
#include <vector>

#include "raylift/localization/localizer.h"
#include "raylift/scene/photographs.h"
#include "raylift/sequences/smooth_queries.h"
#include "raylift/sequences/smoothing.h"
#include "raylift/sequences/walk.h"

namespace raylift {

// A walk, and all photographs with their results by themselves.
struct WalkInputs {
  const Walk& walk;
  std::span<const LocalizedQuery> queries;
  std::span<const Query> photographs;
  const SceneDistances& distances;
};

// Localizes the walk's photographs that are not sure by themselves by options.open_localizer(), and
// smooths the walk by what is found, until nothing more is found. Adds a warning where photographs
// cannot be localized for the scene's files.
void RematchFrames(const WalkInputs& inputs, const SmoothingOptions& options,
                   std::vector<WalkEvidence>& evidence, SmoothedWalk& smoothed,
                   std::vector<std::string>& warnings);

}  // namespace raylift
