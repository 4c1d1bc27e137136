// PLY meshes, ASCII and binary of both byte orders, read directly: unlike assimp this keeps double
// coordinates.

#pragma once

#include <filesystem>

#include "raw_mesh.h"

namespace raylift {

// Vertices with colours (red, green, blue) and texture coordinates (u v, s t, texture_u texture_v),
// polygon faces with per-corner `texcoord` lists and `texnumber`, pictures from the header's
// `comment TextureFile NAME`. Other elements and properties are skipped.
RawMesh ReadPly(const std::filesystem::path& path);

}  // namespace raylift
