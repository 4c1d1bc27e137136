// Points drawn evenly over a mesh's area.

#pragma once

#include <cstdint>
#include <vector>

#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

struct SurfaceSample {
  Eigen::Vector3d point_in_world;
  Eigen::Vector3d normal_in_world;  // unit, by the triangle's winding
};

// Returns no samples if the mesh has no area.
std::vector<SurfaceSample> SampleSurface(const TriangleMesh& mesh, size_t count, uint64_t seed);

}  // namespace raylift
