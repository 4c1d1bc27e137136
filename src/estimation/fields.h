// The estimator's options, and the noise that it finds, as fields.

#pragma once

#include <vector>

#include "base/fields.h"

#include "raylift/estimation/match_noise.h"
#include "raylift/estimation/options.h"

namespace raylift {

std::vector<Field> FieldsOf(EstimatorOptions& options);
// Returns the fields that do not say which method: refinement, thresholds, focal length,
// references' errors, RANSAC, seed.
std::vector<Field> NumberFieldsOf(EstimatorOptions& options);

// Returns the fields of the noise without its numbers of errors.
std::vector<Field> FieldsOf(MatchNoise& noise);

}  // namespace raylift
