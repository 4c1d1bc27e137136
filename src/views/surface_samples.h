// Random points on a mesh, evenly spread by area. Private to views.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

struct SurfaceSample {
  Eigen::Vector3d point_in_world;
  Eigen::Vector3d normal_in_world;  // unit, by the triangle's winding
};

// None where the mesh has no area.
std::vector<SurfaceSample> SampleSurface(const TriangleMesh& mesh, size_t count, uint64_t seed);

}  // namespace raylift
