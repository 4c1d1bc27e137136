// What the space around a point of a scene is like. Private to views.

#pragma once

#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {

// Evenly spread unit vectors (a spiral of Fibonacci).
std::vector<Eigen::Vector3d> SpreadDirections(int count);

struct Surroundings {
  double clearance;    // distance to the nearest surface in any direction; infinite: none
  double front_share;  // of the surfaces that are seen, those seen from their front; 1: none seen
};
Surroundings LookAround(const RayCaster& mesh, const Eigen::Vector3d& center, int directions);

struct Sight {
  double coverage = 0;      // share of the picture that sees a surface
  double front_share = 0;   // of that, seen from its front
  double median_range = 0;  // distance of what is seen
};
Sight LookThrough(const RayCaster& mesh, const Camera& camera, const Rigid3& cam_from_world);

}  // namespace raylift
