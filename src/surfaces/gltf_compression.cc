#include "surfaces/gltf_compression.h"

#include <draco/compression/decode.h>
#include <fmt/format.h>
#include <meshoptimizer.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// More bytes of one never come out: 16 vertices whose bytes do not change take two bits, a triangle
// of three indices one byte.
constexpr size_t kMostMeshoptRatio = 64;

}  // namespace

std::vector<uint32_t> DecodeDraco(std::string_view bytes,
                                  std::span<const DracoAttribute> attributes) {
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  auto decoded = draco::Decoder().DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok()) {
    throw InputError(fmt::format("expected a mesh that Draco compressed: {}",
                                 decoded.status().error_msg_string()));
  }
  const std::unique_ptr<draco::Mesh> mesh = std::move(decoded).value();
  for (const auto& [id, numbers] : attributes) {
    const draco::PointAttribute* const attribute = mesh->GetAttributeByUniqueId(id);
    if (attribute == nullptr) throw InputError(fmt::format("Draco's mesh has no attribute {}", id));
    numbers->values.resize(numbers->components * mesh->num_points());
    for (uint32_t i = 0; i < mesh->num_points(); ++i) {
      attribute->ConvertValue(attribute->mapped_index(draco::PointIndex(i)),
                              static_cast<int8_t>(numbers->components),
                              &numbers->values[i * numbers->components]);
    }
  }
  std::vector<uint32_t> corners;
  corners.reserve(size_t{3} * mesh->num_faces());
  for (uint32_t i = 0; i < mesh->num_faces(); ++i) {
    for (const draco::PointIndex& corner : mesh->face(draco::FaceIndex(i))) {
      corners.push_back(corner.value());
    }
  }
  return corners;
}

std::string DecodeMeshopt(std::string_view bytes, const MeshoptView& view) {
  const bool is_vertices = view.mode == "ATTRIBUTES";
  const bool is_triangles = view.mode == "TRIANGLES";
  if (!is_vertices && !is_triangles && view.mode != "INDICES") {
    throw InputError("expected the mode ATTRIBUTES, TRIANGLES or INDICES");
  }
  const bool is_stride = is_vertices ? view.stride % 4 == 0 && view.stride > 0 && view.stride <= 256
                                     : view.stride == 2 || view.stride == 4;
  if (!is_stride || (is_triangles && view.count % 3 != 0)) {
    throw InputError(fmt::format("{} items of {} bytes are not what {} has", view.count,
                                 view.stride, view.mode));
  }
  if (view.count * view.stride > kMostMeshoptRatio * bytes.size()) {
    throw InputError(
        fmt::format("it claims {} items, more than {} bytes can hold", view.count, bytes.size()));
  }
  std::string decoded(view.count * view.stride, '\0');
  using Decoder = int (*)(void*, size_t, size_t, const unsigned char*, size_t);
  const Decoder decoder = is_vertices    ? Decoder{meshopt_decodeVertexBuffer}
                          : is_triangles ? Decoder{meshopt_decodeIndexBuffer}
                                         : Decoder{meshopt_decodeIndexSequence};
  const int status = decoder(decoded.data(), view.count, view.stride,
                             reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size());
  if (status != 0) throw InputError("the compressed bytes are damaged");
  if (view.filter == "EXPONENTIAL") {
    meshopt_decodeFilterExp(decoded.data(), view.count, view.stride);
  } else if (view.filter == "OCTAHEDRAL" && (view.stride == 4 || view.stride == 8)) {
    meshopt_decodeFilterOct(decoded.data(), view.count, view.stride);
  } else if (view.filter == "QUATERNION" && view.stride == 8) {
    meshopt_decodeFilterQuat(decoded.data(), view.count, view.stride);
  } else if (view.filter != "NONE") {
    throw InputError("expected the filter NONE, OCTAHEDRAL, QUATERNION or EXPONENTIAL");
  }
  return decoded;
}

}  // namespace raylift
