// A finer copy of a mesh, whose surface is the same.

#pragma once

#include "raylift/renderers/triangle_mesh.h"

namespace raylift {

// Edges longer than `max_edge` are halved, again and again: triangles that share one stay neighbors.
// Colors and texture coordinates are interpolated; faces and objects are known as before.
TriangleMesh SplitLongEdges(const TriangleMesh& mesh, double max_edge);

}  // namespace raylift
