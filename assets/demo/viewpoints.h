// Where the demo's photographs are taken, and with which lenses.

#pragma once

#include <vector>

#include "raylift/scene/posed_image.h"

namespace raylift::demo {

// References: two walks around the yard, one looking across it, one looking at the near fronts.
std::vector<PosedImage> ReferenceViews();

// Queries: other lenses, other heights, between the references' places and directions.
std::vector<PosedImage> QueryViews();

}  // namespace raylift::demo
