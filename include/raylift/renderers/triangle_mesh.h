// A triangle mesh as the renderers need it.

#pragma once

#include <array>
#include <cstdint>
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

}  // namespace raylift
