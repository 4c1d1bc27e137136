// A sheet of small color-mapped depth maps, to see at a glance whether the cameras are where they
// should be.

#pragma once

#include <memory>
#include <vector>

#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/image.h"
#include "raylift/scene/photographs.h"

namespace raylift {

inline constexpr int kMaxTiles = 48;

// RGB; at most kMaxTiles of the views, evenly chosen, each with its name, its coverage and the
// range of its depth. Near is red, far is blue, on a logarithmic scale that all tiles share; no
// surface is black. The same bytes for any number of threads.
Image MakeContactSheet(const std::shared_ptr<const RayCaster>& scene,
                       const std::vector<View>& views, int threads);

}  // namespace raylift
