// Which views of a comparison are looked at to explain what is wrong with a source.

#pragma once

#include <span>
#include <vector>

#include "raylift/comparison/depth_explanation.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// A few of the images, evenly spread. Frames follow each other in the order of their names.
std::vector<ExplainedView> ViewsToExplain(const GeometrySource& source, const GeometrySource& truth,
                                          std::span<const PosedImage> images, int threads);

}  // namespace raylift
