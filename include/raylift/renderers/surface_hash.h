// Tells whether two meshes or point clouds are the same.

#pragma once

#include <cstdint>

#include "raylift/renderers/ray_caster.h"

namespace raylift {

// Of all that can be seen of it. The same for any number of threads.
uint64_t SurfaceHash(const RayCaster& scene, int threads);

}  // namespace raylift
