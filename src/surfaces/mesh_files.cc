#include "raylift/surfaces/mesh_files.h"

#include <algorithm>
#include <bit>
#include <iterator>
#include <limits>
#include <span>
#include <utility>

#include "base/bytes.h"
#include "base/input_paths.h"
#include "surfaces/file_readers.h"
#include "surfaces/input_files.h"
#include "surfaces/raw_mesh.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

TriangleMesh ReadPlyMesh(const std::filesystem::path& path, int threads) {
  const MappedFile file(path);
  const PlyHeader header = ParsePlyHeader(path, file.contents());
  if (auto mesh = ReadPlyTriangles(path, header, file.contents(), threads)) return std::move(*mesh);
  return FinishMesh(path, ReadPly(path, header, file.contents()));
}

// Returns whether the file is of CityJSON by its name, or says so itself.
bool IsCityJson(const std::filesystem::path& path, const std::string& extension) {
  if (extension == ".cityjson") return true;
  if (extension != ".json") return false;
  if (LowerExtension(path.stem()) == ".city") return true;
  if (!IsFile(path)) return false;
  constexpr size_t kLookedAt = 4096;
  const MappedFile file(path);
  const std::string_view begin = file.contents().substr(0, kLookedAt);
  // Where keys are sorted, its type comes last.
  return begin.find("\"CityJSON\"") != begin.npos || begin.find("\"CityObjects\"") != begin.npos;
}

bool IsCityGml(const std::string& extension) {
  return extension == ".gml" || extension == ".citygml" || extension == ".xml";
}

TriangleMesh ReadByExtension(const std::filesystem::path& path, const MeshReadOptions& options) {
  const std::string extension = LowerExtension(path);
  if (extension == ".ply") return ReadPlyMesh(path, options.threads);
  const auto level = options.level_of_detail;
  if (IsCityJson(path, extension)) {
    return FinishMesh(path, ReadCityJson(path, MappedFile(path).contents(), level));
  }
  if (extension == ".json") return ReadTileset(path, options);
  if (IsCityGml(extension)) {
    return FinishMesh(path, ReadCityGml(path, MappedFile(path).contents(), level));
  }
  if (extension == ".obj") return FinishMesh(path, ReadObj(path));
  if (extension == ".glb" || extension == ".gltf") {
    const MappedFile file(path);
    return FinishMesh(path, ReadGltf(path, file.contents(), GltfPlace::kFile, ZUpFromYUp()));
  }
  return FinishMesh(path, ReadWithAssimp(path));
}

using std::filesystem::path;

constexpr auto kExtensions = std::to_array<std::string_view>(
    {".ply", ".obj", ".glb", ".gltf", ".stl", ".dae", ".fbx", ".off", ".3ds", ".gml", ".cityjson"});

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
  bool colors = false, coordinates = false, textures = false, faces = false, labels = false;
};

// Appends labels; instances are numbered on across the joined meshes.
void AppendLabels(TriangleMesh mesh, TriangleMesh& target) {
  const auto first_label = static_cast<uint32_t>(target.labels.size());
  for (uint32_t& label : mesh.triangle_labels) {
    if (label != SurfaceLabel::kNone) label += first_label;
  }
  AppendAttribute(mesh.triangle_labels, mesh.triangles.size(), SurfaceLabel::kNone,
                  target.triangle_labels);
  for (SurfaceLabel& label : mesh.labels) {
    if (label.instance != SurfaceLabel::kNone) label.instance += target.num_instances;
    target.labels.push_back(std::move(label));
  }
  target.num_instances += mesh.num_instances;
}

// Returns the system that is named by those of the meshes that name one; empty where they differ.
std::string CommonSystem(std::span<const TriangleMesh> meshes, std::vector<std::string>& warnings) {
  std::string common;
  for (const TriangleMesh& mesh : meshes) {
    if (common.empty()) common = mesh.crs;
    if (mesh.crs.empty() || mesh.crs == common) continue;
    warnings.push_back(fmt::format("of meshes that are taken as one, one is in {}, another in {}",
                                   common, mesh.crs));
    return {};
  }
  return common;
}

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
  if (attributes.labels) AppendLabels(std::move(mesh), target);
}

static_assert(std::endian::native == std::endian::little, "bytes are written as they are");

}  // namespace

TriangleMesh ReadMesh(const std::filesystem::path& path, const MeshReadOptions& options) {
  if (!Exists(path)) throw InputError(path, "no such file");
  if (IsFolder(path)) {
    throw InputError(path, "expected a mesh file, found a folder");
  }
  return ReadByExtension(path, options);
}

TriangleMesh MakeMesh(std::vector<Eigen::Vector3d> vertices,
                      std::vector<std::array<uint32_t, 3>> triangles,
                      std::vector<std::array<uint8_t, 3>> colors_rgb) {
  if (!colors_rgb.empty() && colors_rgb.size() != vertices.size()) {
    throw InputError(fmt::format("mesh: expected a color for each of {} vertices, found {}",
                                 vertices.size(), colors_rgb.size()));
  }
  for (size_t i = 0; i < triangles.size(); ++i) {
    for (const uint32_t index : triangles[i]) {
      if (index >= vertices.size()) {
        throw InputError(
            fmt::format("mesh: triangle {}: expected indices into {} vertices, found {}", i,
                        vertices.size(), index));
      }
    }
  }
  RawMesh raw;
  raw.positions = std::move(vertices);
  raw.position_colors = std::move(colors_rgb);
  raw.triangles = std::move(triangles);
  return FinishMesh("mesh", std::move(raw));
}

std::vector<path> ListMeshFiles(const std::string& files) {
  return ListFiles(files, kExtensions, "mesh", "tileset.json");
}

MeshKind MeshKindOf(const path& file) {
  const std::string extension = LowerExtension(file);
  if (IsCityGml(extension) || IsCityJson(file, extension)) return MeshKind::kCityModel;
  return extension == ".json" ? MeshKind::kTileset : MeshKind::kOther;
}

void RequireWorld(const path& file, const TileOptions& options) {
  if (options.world || !IsEarthCentered(file)) return;
  throw InputError(file,
                   "earth-centered 3D Tiles beside other meshes: expected crs=EPSG:N, the system "
                   "that all of them are in");
}

bool IsMeshFileName(const path& file) {
  const bool is_city = LowerExtension(file) == ".json" && LowerExtension(file.stem()) == ".city";
  return is_city || std::find(kExtensions.begin(), kExtensions.end(), LowerExtension(file)) !=
                        kExtensions.end();
}

TriangleMesh ReadMeshes(std::span<const path> files, const MeshReadOptions& options) {
  RAYLIFT_CHECK(!files.empty());
  if (files.size() == 1) return ReadMesh(files.front(), options);
  std::vector<TriangleMesh> meshes;
  for (const path& file : files) RequireWorld(file, options.tiles);
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
    attributes.labels |= !mesh.labels.empty();
  }
  merged.crs = CommonSystem(meshes, merged.warnings);
  merged.vertices.reserve(num_vertices + 1);  // the ray caster wants room for one more
  merged.triangles.reserve(num_triangles);
  for (TriangleMesh& mesh : meshes) {
    Append(std::move(mesh), attributes, merged);
    mesh = TriangleMesh();
  }
  NumberMaterials(merged);
  return merged;
}

void WritePly(const std::filesystem::path& path, const TriangleMesh& mesh) {
  const bool far_away = !mesh.origin_in_world.isZero(0);
  const bool has_colors = !mesh.vertex_colors_rgb.empty();
  const char* const type = far_away ? "double" : "float";
  std::string header = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment written by Raylift\nelement vertex {0}\n"
      "property {1} x\nproperty {1} y\nproperty {1} z\n",
      mesh.vertices.size(), type);
  if (has_colors) header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  header += fmt::format("element face {}\nproperty list uchar int vertex_indices\nend_header\n",
                        mesh.triangles.size());
  std::string body;
  body.reserve(mesh.vertices.size() * (far_away ? 27 : 15) + mesh.triangles.size() * 13);
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    if (far_away) {
      const Eigen::Vector3d vertex = mesh.VertexInWorld(static_cast<uint32_t>(i));
      body += AsBytes(std::span(vertex.data(), 3));
    } else {
      body += AsBytes(std::span(mesh.vertices[i].data(), 3));
    }
    if (has_colors) body += AsBytes(std::span(mesh.vertex_colors_rgb[i]));
  }
  for (const auto& triangle : mesh.triangles) {
    body += '\3';
    body += AsBytes(std::span(triangle));
  }
  const std::string_view parts[] = {header, body};
  WriteFile(path, parts);
}

}  // namespace raylift
