// Lists the filter's and the candidates' options, and the filter's counts, as fields.

#pragma once

#include <vector>

#include "base/fields.h"

#include "raylift/lifting/consistency_filter.h"
#include "raylift/lifting/lifter.h"

namespace raylift {

std::vector<Field> FieldsOf(ConsistencyThresholds& thresholds);
// Returns the mode and the thresholds.
std::vector<Field> FieldsOf(FilterOptions& options);
std::vector<Field> FieldsOf(CandidateOptions& options);
std::vector<Field> FieldsOf(FilterCounts& counts);

}  // namespace raylift
