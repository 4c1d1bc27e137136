// Makes coarser and finer copies of a mesh, and samples of its surface.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

// Returns a coarser mesh: all vertices in a cell of a grid become one, at their mean and of their
// mean color; textures become colors of vertices. The cells are the smallest that give no more
// triangles than asked for. A mesh that has no more is returned as it is.
TriangleMesh DecimatedMesh(const TriangleMesh& mesh, size_t max_triangles);

// Returns a finer mesh: edges longer than `max_edge` are halved repeatedly, and triangles that
// share one stay neighbors. Colors and texture coordinates are interpolated; faces and objects are
// known as before.
TriangleMesh SplitLongEdges(const TriangleMesh& mesh, double max_edge);

// Returns the sum of the areas of the triangles.
double AreaOf(const TriangleMesh& mesh);

// A point drawn evenly over a mesh's area.
struct SurfaceSample {
  Eigen::Vector3d point_in_world;
  Eigen::Vector3d normal_in_world;  // unit, by the triangle's winding
};

// Returns no samples if the mesh has no area.
std::vector<SurfaceSample> SampleSurface(const TriangleMesh& mesh, size_t count, uint64_t seed);

}  // namespace raylift
