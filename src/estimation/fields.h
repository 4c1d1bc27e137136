// The estimator's options, and the noise that it finds, as fields.

#pragma once

#include <vector>

#include "base/fields.h"

#include "raylift/estimation/match_noise.h"
#include "raylift/estimation/options.h"

namespace raylift {

std::vector<Field> FieldsOf(EstimatorOptions& options);
// Those that do not say which method: thresholds, RANSAC, the seed.
std::vector<Field> NumberFieldsOf(EstimatorOptions& options);

// Without what the errors have shown it.
std::vector<Field> FieldsOf(MatchNoise& noise);

}  // namespace raylift
