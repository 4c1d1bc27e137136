// Wavefront OBJ meshes with their MTL materials, read directly: unlike assimp this keeps the double
// coordinates that georeferenced scenes are written with.

#pragma once

#include <filesystem>

#include "raw_mesh.h"

namespace raylift {

// v (with colors where six numbers are given), vt, f, usemtl and mtllib; from materials Kd and
// map_Kd. Everything else is skipped.
RawMesh ReadObj(const std::filesystem::path& path);

}  // namespace raylift
