// Meshes from files: PLY, OBJ (both read in double), and whatever else assimp reads (GLB/glTF, STL,
// DAE, FBX, ...; in float).

#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "raylift/renderers/triangle_mesh.h"

namespace raylift {

struct MeshReadOptions {
  int threads = 0;  // <= 0: all; never changes the mesh
};

// Reads a mesh. Faces with more than three corners are triangulated; triangles with a non-finite
// vertex or no area are removed and counted in `warnings`, vertices that no triangle uses are
// dropped. A texture that cannot be read is a warning. InputError naming the file where it is
// missing, unreadable, has an index out of range (naming the face), or has no triangle left (a
// point cloud says so).
TriangleMesh ReadMesh(const std::filesystem::path& path, const MeshReadOptions& options = {});

// The same from memory. Colors are one per vertex, or none at all. InputError where an index is out
// of range, the counts differ, or no triangle is left.
TriangleMesh MakeMesh(std::vector<Eigen::Vector3d> vertices,
                      std::vector<std::array<uint32_t, 3>> triangles,
                      std::vector<std::array<uint8_t, 3>> colors_rgb = {});

}  // namespace raylift
