// Why cameras may all miss a mesh, point cloud or splats. Private to views.

#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/renderers/ray_caster.h"

namespace raylift {

// One sentence: where both are, and what may be wrong with unit, origin or axes. At least one
// camera.
std::string WhyTheMeshIsUnseen(const RayCaster& scene,
                               const std::vector<Eigen::Vector3d>& camera_centers);

}  // namespace raylift
