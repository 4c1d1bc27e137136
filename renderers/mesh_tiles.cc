#include "raylift/renderers/mesh_tiles.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <limits>

#include "file_list.h"

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::array<std::string_view, 9> kExtensions = {".ply", ".obj", ".glb", ".gltf", ".stl",
                                                         ".dae", ".fbx", ".off", ".3ds"};

template <typename T>
void AppendAttribute(const std::vector<T>& values, size_t count, const T& missing,
                     std::vector<T>& target) {
  if (values.empty()) {
    target.resize(target.size() + count, missing);
  } else {
    target.insert(target.end(), values.begin(), values.end());
  }
}

struct Attributes {
  bool colors = false, coordinates = false, textures = false, faces = false;
};

void Append(TriangleMesh mesh, const Attributes& attributes, TriangleMesh& target) {
  const size_t first_vertex = target.vertices.size();
  if (mesh.vertices.size() > std::numeric_limits<uint32_t>::max() - first_vertex) {
    throw InputError("the meshes together have more than 2^32 vertices");
  }
  const auto offset = static_cast<uint32_t>(first_vertex);
  target.object_begins.push_back(static_cast<uint32_t>(target.triangles.size()));
  for (uint32_t i = 0; attributes.faces && i < mesh.triangles.size(); ++i) {
    target.triangle_faces.push_back(mesh.FaceOf(i));
  }
  const Eigen::Vector3d shift = mesh.origin_in_world - target.origin_in_world;
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    target.vertices.push_back((vertex.cast<double>() + shift).cast<float>());
  }
  for (const auto& triangle : mesh.triangles) {
    target.triangles.push_back({triangle[0] + offset, triangle[1] + offset, triangle[2] + offset});
  }
  if (attributes.colors) {
    AppendAttribute(mesh.vertex_colors_rgb, mesh.vertices.size(), {255, 255, 255},
                    target.vertex_colors_rgb);
  }
  if (attributes.coordinates) {
    AppendAttribute(mesh.texture_coordinates, mesh.vertices.size(), {0.0f, 0.0f},
                    target.texture_coordinates);
  }
  if (attributes.textures) {
    const auto first_texture = static_cast<int32_t>(target.textures.size());
    for (int32_t& texture : mesh.triangle_textures) {
      if (texture >= 0) texture += first_texture;
    }
    AppendAttribute(mesh.triangle_textures, mesh.triangles.size(), -1, target.triangle_textures);
    std::move(mesh.textures.begin(), mesh.textures.end(), std::back_inserter(target.textures));
  }
  target.warnings.insert(target.warnings.end(), mesh.warnings.begin(), mesh.warnings.end());
}

}  // namespace

std::vector<path> ListMeshFiles(const std::string& files) {
  return ListFiles(files, kExtensions, "mesh");
}

TriangleMesh ReadMeshes(std::span<const path> files, const MeshReadOptions& options) {
  RAYLIFT_CHECK(!files.empty());
  if (files.size() == 1) return ReadMesh(files.front(), options);
  std::vector<TriangleMesh> meshes;
  for (const path& file : files) meshes.push_back(ReadMesh(file, options));
  return MergeMeshes(std::move(meshes));
}

TriangleMesh MergeMeshes(std::vector<TriangleMesh> meshes) {
  TriangleMesh merged;
  Attributes attributes;
  size_t num_vertices = 0;
  size_t num_triangles = 0;
  for (const TriangleMesh& mesh : meshes) {
    merged.origin_in_world += mesh.origin_in_world / static_cast<double>(meshes.size());
    num_vertices += mesh.vertices.size();
    num_triangles += mesh.triangles.size();
    attributes.colors |= !mesh.vertex_colors_rgb.empty();
    attributes.coordinates |= !mesh.texture_coordinates.empty();
    attributes.textures |= !mesh.triangle_textures.empty();
    attributes.faces |= !mesh.triangle_faces.empty();
  }
  merged.vertices.reserve(num_vertices + 1);  // the ray caster wants room for one more
  merged.triangles.reserve(num_triangles);
  for (TriangleMesh& mesh : meshes) {
    Append(std::move(mesh), attributes, merged);
    mesh = TriangleMesh();
  }
  return merged;
}

}  // namespace raylift
