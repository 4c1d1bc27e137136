// A list of methods to compare, as `compare --methods` takes it.

#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "raylift/estimation/pose_estimator.h"

namespace raylift {

// "p3p,adaptive:mult_inl,select:0.7": names of methods, Adaptive's with a score and Select's with
// an alpha where these are not those of `base`. OptionError in the name of --methods otherwise.
std::vector<EstimatorOptions> ParseMethods(std::string_view text, const EstimatorOptions& base);

// "p3p|...|adaptive[:SCORE]|...", for help.
std::string MethodForms();

}  // namespace raylift
