// `raylift localize --continuous`: queries in an order of their own, some of which join the
// references.

#pragma once

#include <span>
#include <string>
#include <vector>

#include "apps/lap_clock.h"
#include "apps/localize_flags.h"
#include "apps/localize_output.h"

#include "raylift/localization/batch_localizer.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// A folder holds a run with --continuous or one without it: OptionError, or --overwrite removes the
// other.
void RefuseOtherMode(const LocalizeFlags& flags);

struct ContinuousInputs {
  const Scene& scene;
  std::span<const Query> queries;
  const BatchOptions& options;
  const std::vector<std::string>& warnings;  // of the scene
  const std::string& options_json;
  LapClock clock;
  RunTimes times;  // as far as they are known
};

// Localizes all queries and writes what was asked for. Interrupted where a signal came first.
void LocalizeContinuously(const LocalizeFlags& flags, const ContinuousInputs& inputs,
                          LocalizeOutput& output);

}  // namespace raylift
