// The formats of meshes, a reader each.

#pragma once

#include <filesystem>
#include <optional>
#include <string_view>

#include "surfaces/ply_file.h"
#include "surfaces/raw_mesh.h"

#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

// Vertices with colors (red, green, blue) and texture coordinates (u v, s t, texture_u texture_v),
// polygon faces with per-corner `texcoord` lists and `texnumber`, pictures from the header's
// `comment TextureFile NAME`; normals (nx ny nz) where there are no faces. Other elements and
// properties are skipped.
// `contents` is the whole file; `path` is for messages and for the pictures beside it.
RawMesh ReadPly(const std::filesystem::path& path, const PlyHeader& header,
                std::string_view contents);

// The fast path for what nearly all large meshes are: binary PLY files of this machine's byte
// order, whose faces are triangles. Read from the mapped file straight into the mesh, in parallel.

// As FinishMesh(ReadPly(...)), but that vertices stay in the file's order. None where the file
// needs the general reader: another layout, textures, polygons, anything wrong that it will name.
std::optional<TriangleMesh> ReadPlyTriangles(const std::filesystem::path& path,
                                             const PlyHeader& header, std::string_view contents,
                                             int threads);

// Wavefront OBJ meshes with their MTL materials, read directly: unlike assimp this keeps the double
// coordinates that georeferenced scenes are written with.

// v (with colors where six numbers are given), vt, f, usemtl and mtllib; from materials Kd and
// map_Kd. Everything else is skipped.
RawMesh ReadObj(const std::filesystem::path& path);

// Every mesh format without a reader of our own, through assimp. Its coordinates are float.

// All meshes of the file's node graph, in the root's frame.
RawMesh ReadWithAssimp(const std::filesystem::path& path);

// What assimp takes for granted of a glTF file, and ends the process where it is not so. Private to
// renderers.

// InputError naming the file and the JSON path where the file is no glTF 2 (text or binary), its
// sizes are beyond what is there, an index is beyond its list, or nodes are no tree.
void CheckGltf(const std::filesystem::path& path, std::string_view contents);

}  // namespace raylift
