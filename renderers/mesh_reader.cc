#include "raylift/renderers/mesh_reader.h"

#include <algorithm>
#include <cctype>

#include "assimp_reader.h"
#include "mapped_file.h"
#include "obj_reader.h"
#include "ply_reader.h"
#include "ply_triangle_reader.h"
#include "raw_mesh.h"

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
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
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

}  // namespace raylift
