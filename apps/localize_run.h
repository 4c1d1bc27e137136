// The work of `raylift localize`.

#pragma once

#include <string>

#include "localize_flags.h"

#include "raylift/estimation/pose_estimator.h"

namespace raylift {

// Localizes all queries and writes what was asked for; `options_json` holds the effective options.
void RunLocalize(const LocalizeFlags& flags, const GeometryOptions& geometry,
                 const FilterOptions& filter, const EstimatorOptions& estimator,
                 const std::string& options_json);

}  // namespace raylift
