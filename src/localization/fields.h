// What the stages of a localization count, and what a query needs to join the references, as
// fields.

#pragma once

#include <vector>

#include "base/fields.h"
#include "localization/continuous/join_gate.h"

#include "raylift/localization/localizer.h"

namespace raylift {

// The filter's counts among them; without the points of each source and the noise.
std::vector<Field> FieldsOf(StageCounts& counts);
std::vector<Field> FieldsOf(JoinGateOptions& options);

}  // namespace raylift
