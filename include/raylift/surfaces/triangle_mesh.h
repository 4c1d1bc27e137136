// A triangle mesh as the renderers need it.

#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/image.h"

namespace raylift {

// The names of a part of the surface in the mesh's file.
struct SurfaceLabel {
  static constexpr uint32_t kNone = 0xffffffffu;

  uint32_t instance = kNone;  // which node, group or object of the scene it is, from 0
  std::string instance_name;  // with those above it, between slashes
  std::string material;       // of a city model the kind of its surface, as RoofSurface

  // The number of the material's name in the scene, or the id that a table gives to the two names.
  uint32_t semantic = kNone;
  std::string semantic_name;
};

struct TriangleMesh {
  // Vertices are float, relative to this origin, which is subtracted in double before rounding:
  // world coordinates of 1e6 m keep their precision.
  Eigen::Vector3d origin_in_world = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;

  // There is one for each vertex; the list is empty where the mesh has none.
  std::vector<std::array<uint8_t, 3>> vertex_colors_rgb;
  std::vector<Eigen::Vector2f> texture_coordinates;  // (u, v), v = 0 at the picture's last row

  // Holds for each triangle an index into `textures`, or -1 where it has none; empty where the mesh
  // has no texture.
  std::vector<int32_t> triangle_textures;
  std::vector<Image> textures;

  // Holds for each triangle the face of its file that it belongs to, where polygons were
  // triangulated or faces dropped; empty where that is the triangle's own index.
  std::vector<uint32_t> triangle_faces;
  // Holds the first triangle of each mesh where several were joined; empty where it is one mesh.
  std::vector<uint32_t> object_begins;

  // Holds for each triangle an index into `labels`, or SurfaceLabel::kNone; empty where there are
  // no labels.
  std::vector<uint32_t> triangle_labels;
  std::vector<SurfaceLabel> labels;
  uint32_t num_instances = 0;  // theirs are below it

  // Names the coordinate reference system of its coordinates, as WorldFrame::Parse() takes it,
  // where its file does so.
  std::string crs;

  // The reader warns the user of this: degenerate triangles removed, a texture missing, ...
  std::vector<std::string> warnings;

  // Returns the index of the joined mesh that a triangle belongs to.
  uint32_t ObjectOf(uint32_t triangle) const {
    if (object_begins.empty()) return 0;
    const auto next = std::upper_bound(object_begins.begin(), object_begins.end(), triangle);
    return static_cast<uint32_t>(next - object_begins.begin()) - 1;
  }
  // Returns the triangle's face in that mesh's file, counted from 0.
  uint32_t FaceOf(uint32_t triangle) const {
    if (!triangle_faces.empty()) return triangle_faces[triangle];
    return object_begins.empty() ? triangle : triangle - object_begins[ObjectOf(triangle)];
  }

  // Returns the label of the triangle's part; one without names where the file has none.
  const SurfaceLabel& LabelOf(uint32_t triangle) const {
    static const SurfaceLabel kWithoutNames;
    if (triangle_labels.empty() || triangle_labels[triangle] == SurfaceLabel::kNone)
      return kWithoutNames;
    return labels[triangle_labels[triangle]];
  }

  Eigen::Vector3d VertexInWorld(uint32_t index) const {
    return origin_in_world + vertices[index].cast<double>();
  }
};

}  // namespace raylift
