// A triangle mesh as the renderers need it, from PLY, OBJ (both read in double), and any other file
// that assimp reads (GLB/glTF, STL, DAE, FBX, ...; in float).

#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/image.h"

namespace raylift {

struct TriangleMesh {
  // Vertices are float, relative to this origin, which is subtracted in double before rounding:
  // world coordinates of 1e6 m keep their precision.
  Eigen::Vector3d origin_in_world = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;

  // Per vertex; empty where the mesh has none.
  std::vector<std::array<uint8_t, 3>> vertex_colors_rgb;
  std::vector<Eigen::Vector2f> texture_coordinates;  // (u, v), v = 0 at the picture's last row

  // Per triangle, index into `textures`, -1 = none; empty where the mesh has no texture.
  std::vector<int32_t> triangle_textures;
  std::vector<Image> textures;

  // What the reader should tell the user: degenerate triangles removed, a texture missing, ...
  std::vector<std::string> warnings;

  Eigen::Vector3d VertexInWorld(uint32_t index) const {
    return origin_in_world + vertices[index].cast<double>();
  }
};

struct MeshReadOptions {
  int threads = 0;  // <= 0: all; never changes the mesh
};

// Reads a mesh. Faces with more than three corners are triangulated; triangles with a non-finite
// vertex or no area are removed and counted in `warnings`, vertices that no triangle uses are
// dropped. A texture that cannot be read is a warning. InputError naming the file where it is
// missing, unreadable, has an index out of range (naming the face), or has no triangle left (a
// point cloud says so).
TriangleMesh ReadMesh(const std::filesystem::path& path, const MeshReadOptions& options = {});

}  // namespace raylift
