// What the results of `raylift localize` depend on, as its manifest begins with it.

#pragma once

#include <span>
#include <string>

#include "apps/localize_flags.h"

#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// JSON: the options that matter, and fingerprints of the inputs in place of their paths, so that
// the same run may go on on another machine.
std::string LocalizeHeader(const LocalizeFlags& flags, const std::string& options_json,
                           const Scene& scene, std::span<const Query> queries);

}  // namespace raylift
