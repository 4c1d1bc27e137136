// Where the demo's photographs are taken, and with which lenses.

#pragma once

#include <vector>

#include "base/rng.h"

#include "raylift/scene/photographs.h"

namespace raylift::demo {

// References: two walks around the yard, one looking across it, one looking at the near fronts.
std::vector<PosedImage> ReferenceViews();

// Queries: other lenses, other heights, between the references' places and directions.
std::vector<PosedImage> QueryViews();

// The same views from places up to 0.2 m and directions up to 5 degrees away.
void MoveViews(Rng& rng, std::vector<PosedImage>& views);

}  // namespace raylift::demo
