// Where the surfaces of a scene leave room for cameras.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/triangle_mesh.h"
#include "raylift/views/view_sampler.h"

namespace raylift {

struct Surroundings {
  double clearance;    // distance to the nearest surface in any direction; infinite: none
  double front_share;  // of the surfaces that are seen, those seen from their front; 1: none seen
};
Surroundings ProbeSurroundings(const RayCaster& mesh, const Eigen::Vector3d& center,
                               int directions);

struct VisibleSurface {
  double coverage = 0;      // share of the picture that sees a surface
  double front_share = 0;   // of that, seen from its front
  double median_range = 0;  // distance of what is seen
};
VisibleSurface MeasureView(const RayCaster& mesh, const Camera& camera,
                           const Rigid3& cam_from_world);

// Points of the ground, on a grid, of the largest connected area; empty where there is none. Room
// for the eye height and the clearance is above each.
std::vector<Eigen::Vector3d> FindWalkableGround(const RayCaster& mesh,
                                                const ViewSamplerOptions& options,
                                                const InsideOptions& inside);

}  // namespace raylift
