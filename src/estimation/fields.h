// The estimator's options as fields: on the command line, as Python's keywords, in files.

#pragma once

#include <vector>

#include "base/fields.h"

#include "raylift/estimation/options.h"

namespace raylift {

// Those that say which method, and the others: thresholds, RANSAC, the seed.
std::vector<Field> MethodFieldsOf(EstimatorOptions& options);
std::vector<Field> NumberFieldsOf(EstimatorOptions& options);
// All of them.
std::vector<Field> FieldsOf(EstimatorOptions& options);

}  // namespace raylift
