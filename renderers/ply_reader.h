// PLY meshes, ASCII and binary of both byte orders, read directly: unlike assimp this keeps double
// coordinates.

#pragma once

#include <filesystem>
#include <string_view>

#include "ply_header.h"
#include "raw_mesh.h"

namespace raylift {

// Vertices with colors (red, green, blue) and texture coordinates (u v, s t, texture_u texture_v),
// polygon faces with per-corner `texcoord` lists and `texnumber`, pictures from the header's
// `comment TextureFile NAME`; normals (nx ny nz) where there are no faces. Other elements and
// properties are skipped.
// `contents` is the whole file; `path` is for messages and for the pictures beside it.
RawMesh ReadPly(const std::filesystem::path& path, const PlyHeader& header,
                std::string_view contents);

}  // namespace raylift
