#include "raylift/renderers/mesh_writer.h"

#include <bit>
#include <cstring>
#include <string>

#include <fmt/format.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

static_assert(std::endian::native == std::endian::little);

template <typename T>
void Append(const T* values, size_t count, std::string& bytes) {
  const size_t begin = bytes.size();
  bytes.resize(begin + count * sizeof(T));
  std::memcpy(bytes.data() + begin, values, count * sizeof(T));
}

}  // namespace

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
      Append(mesh.VertexInWorld(static_cast<uint32_t>(i)).eval().data(), 3, body);
    } else {
      Append(mesh.vertices[i].data(), 3, body);
    }
    if (has_colors) Append(mesh.vertex_colors_rgb[i].data(), 3, body);
  }
  for (const auto& triangle : mesh.triangles) {
    body += '\3';
    Append(triangle.data(), 3, body);
  }
  const std::string_view parts[] = {header, body};
  WriteFile(path, parts);
}

}  // namespace raylift
