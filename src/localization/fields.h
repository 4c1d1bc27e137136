// Lists the options of matching and of joining the references, and the counts of the stages, as
// fields.

#pragma once

#include <vector>

#include "base/fields.h"
#include "localization/continuous/join_gate.h"

#include "raylift/localization/localizer.h"
#include "raylift/localization/match_source.h"

namespace raylift {

// Returns the counts, with the filter's; without the points of each source and the noise.
std::vector<Field> FieldsOf(StageCounts& counts);
std::vector<Field> FieldsOf(JoinGateOptions& options);
std::vector<Field> FieldsOf(MatchReading& reading);
// Returns the fields of max_features and max_ratio alone.
std::vector<Field> FieldsOf(FrontEndOptions& options);

}  // namespace raylift
