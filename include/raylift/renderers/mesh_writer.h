// Meshes for other programs.

#pragma once

#include <filesystem>

#include "raylift/renderers/triangle_mesh.h"

namespace raylift {

// Binary PLY with the mesh's vertices (float; double where it has an origin of its own), triangles
// and, where it has them, vertex colors. Textures are left out. OutputError where it cannot be
// written.
void WritePly(const std::filesystem::path& path, const TriangleMesh& mesh);

}  // namespace raylift
