// What the renderers' tests cast rays at.

#pragma once

#include <memory>
#include <utility>

#include "raylift/renderers/ray_caster.h"

namespace raylift {

inline RayCaster MakeCaster(TriangleMesh mesh, const RayCasterOptions& options = {}) {
  return RayCaster(std::make_shared<const TriangleMesh>(std::move(mesh)), options);
}

}  // namespace raylift
