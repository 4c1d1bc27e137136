// Scenes that come as several meshes: tiles of a city, a building and its furniture.

#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "raylift/renderers/mesh_reader.h"
#include "raylift/renderers/triangle_mesh.h"

namespace raylift {

// The files that "a.ply+b.obj", "tiles/*.ply" or a folder (all mesh files in it) name, sorted
// within each part. A file whose own name holds "+" or "*" is that file. InputError where a part
// names no file.
std::vector<std::filesystem::path> ListMeshFiles(const std::string& files);

// Reads all of them as one mesh.
TriangleMesh ReadMeshes(std::span<const std::filesystem::path> files,
                        const MeshReadOptions& options = {});

// One mesh of all of them, recentered. Vertex colors, texture coordinates and textures stay where
// any mesh has them; the others' vertices are white there.
TriangleMesh MergeMeshes(std::vector<TriangleMesh> meshes);

}  // namespace raylift
