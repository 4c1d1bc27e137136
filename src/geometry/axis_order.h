// The order of a system's axes, which coordinates as drawn on a map (Crs) do not follow.

#pragma once

#include "raylift/geometry/geodesy.h"

namespace raylift {

// Returns whether the authority has northings before eastings.
bool NorthingsComeFirst(const Crs& crs);

}  // namespace raylift
