#include "raylift/renderers/mesh_reader.h"

#include <utility>

#include "assimp_reader.h"
#include "foreign_text.h"
#include "mapped_file.h"
#include "obj_reader.h"
#include "ply_reader.h"
#include "ply_triangle_reader.h"
#include "raw_mesh.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

TriangleMesh ReadPlyMesh(const std::filesystem::path& path, int threads) {
  const MappedFile file(path);
  const PlyHeader header = ParsePlyHeader(path, file.contents());
  if (auto mesh = ReadPlyTriangles(path, header, file.contents(), threads)) {
    return std::move(*mesh);
  }
  return FinishMesh(path, ReadPly(path, header, file.contents()));
}

TriangleMesh ReadByExtension(const std::filesystem::path& path, int threads) {
  const std::string extension = LowerExtension(path);
  if (extension == ".ply") return ReadPlyMesh(path, threads);
  if (extension == ".obj") return FinishMesh(path, ReadObj(path));
  return FinishMesh(path, ReadWithAssimp(path));
}

}  // namespace

TriangleMesh ReadMesh(const std::filesystem::path& path, const MeshReadOptions& options) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) {
    throw InputError(path, "no such file");
  }
  if (std::filesystem::is_directory(path, ignored)) {
    throw InputError(path, "expected a mesh file, found a folder");
  }
  return ReadByExtension(path, options.threads);
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

}  // namespace raylift
