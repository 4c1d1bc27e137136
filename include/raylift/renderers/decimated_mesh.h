// A coarser copy of a mesh to look at, for files that go over the web.

#pragma once

#include <cstddef>

#include "raylift/renderers/triangle_mesh.h"

namespace raylift {

// All vertices in a cell of a grid become one, at their mean and of their mean color; textures
// become colors of vertices. The cells are as small as no more triangles than asked for allow. A
// mesh that has no more comes back as it is.
TriangleMesh DecimatedMesh(const TriangleMesh& mesh, size_t max_triangles);

}  // namespace raylift
