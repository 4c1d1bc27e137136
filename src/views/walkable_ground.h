// The ground of a scene on which a person could walk. Private to views.

#pragma once

#include <vector>

#include <Eigen/Core>

#include "raylift/renderers/ray_caster.h"
#include "raylift/views/view_sampler.h"

namespace raylift {

// Points of the ground, on a grid, of the largest connected area; empty where there is none. Room
// for the eye height and the clearance is above each.
std::vector<Eigen::Vector3d> FindWalkableGround(const RayCaster& mesh,
                                                const ViewSamplerOptions& options,
                                                const InsideOptions& inside);

}  // namespace raylift
