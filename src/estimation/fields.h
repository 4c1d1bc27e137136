// The estimator's options, and the noise that it finds, as fields.

#pragma once

#include <vector>

#include "base/fields.h"

#include "raylift/estimation/match_noise.h"
#include "raylift/estimation/options.h"

namespace raylift {

// Those that say which method, and the others: thresholds, RANSAC, the seed.
std::vector<Field> MethodFieldsOf(EstimatorOptions& options);
std::vector<Field> NumberFieldsOf(EstimatorOptions& options);
// All of them.
std::vector<Field> FieldsOf(EstimatorOptions& options);

// Without what the errors have shown it.
std::vector<Field> FieldsOf(MatchNoise& noise);

}  // namespace raylift
