// The work of `raylift localize`.

#pragma once

#include <string>

#include "apps/localize_flags.h"

#include "raylift/lifting/depth_alignment.h"
#include "raylift/localization/localizer.h"

namespace raylift {

// Localizes all queries and writes what was asked for; `options_json` holds the effective options.
void RunLocalize(const LocalizeFlags& flags, const LocalizerOptions& options, AlignMode align,
                 const std::string& options_json);

}  // namespace raylift
