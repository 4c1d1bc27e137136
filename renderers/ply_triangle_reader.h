// The fast path for what nearly all large meshes are: binary PLY files of this machine's byte
// order, whose faces are triangles. Read from the mapped file straight into the mesh, in parallel.

#pragma once

#include <filesystem>
#include <optional>
#include <string_view>

#include "ply_header.h"

#include "raylift/renderers/triangle_mesh.h"

namespace raylift {

// As FinishMesh(ReadPly(...)), but that vertices stay in the file's order. None where the file
// needs the general reader: another layout, textures, polygons, anything wrong that it will name.
std::optional<TriangleMesh> ReadPlyTriangles(const std::filesystem::path& path,
                                             const PlyHeader& header, std::string_view contents,
                                             int threads);

}  // namespace raylift
