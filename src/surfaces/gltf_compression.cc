#include <cstring>
#include <exception>
#include <memory>
#include <new>
#include <utility>

#include "base/read_limits.h"
#include "surfaces/gltf_file.h"
#include <draco/compression/decode.h>
#include <draco/core/varint_decoding.h>
#include <draco/metadata/metadata_decoder.h>
#include <fmt/format.h>
#include <meshoptimizer.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// More bytes of one never come out: 16 vertices whose bytes do not change take two bits, a triangle
// of three indices one byte.
constexpr size_t kMostMeshoptRatio = 64;

draco::DecoderBuffer BufferOf(std::string_view bytes) {
  draco::DecoderBuffer buffer;
  buffer.Init(bytes.data(), bytes.size());
  return buffer;
}

// Returns whether the bytes begin as Draco's do. Draco's own function needs headers that Ubuntu
// 22.04 lacks.
bool ReadHeader(draco::DecoderBuffer& buffer, draco::DracoHeader& header) {
  return buffer.Decode(header.draco_string, sizeof(header.draco_string)) &&
         std::memcmp(header.draco_string, "DRACO", sizeof(header.draco_string)) == 0 &&
         buffer.Decode(&header.version_major) && buffer.Decode(&header.version_minor) &&
         buffer.Decode(&header.encoder_type) && buffer.Decode(&header.encoder_method) &&
         buffer.Decode(&header.flags);
}

// Holds what the header claims against the bytes, as the decoder takes memory for it.
void CheckDracoClaims(std::string_view bytes) {
  draco::DecoderBuffer buffer = BufferOf(bytes);
  draco::DracoHeader header;
  if (!ReadHeader(buffer, header)) throw InputError("expected a mesh that Draco compressed");
  if (DRACO_BITSTREAM_VERSION(header.version_major, header.version_minor) <
      DRACO_BITSTREAM_VERSION(2, 2)) {
    throw InputError(fmt::format("expected Draco's bitstream 2.2, as glTF has it, found {}.{}",
                                 header.version_major, header.version_minor));
  }
  buffer.set_bitstream_version(DRACO_BITSTREAM_VERSION(2, 2));
  if ((header.flags & METADATA_FLAG_MASK) != 0) {
    draco::GeometryMetadata metadata;
    if (!draco::MetadataDecoder().DecodeGeometryMetadata(&buffer, &metadata)) {
      throw InputError("Draco's metadata are damaged");
    }
  }
  uint8_t traversal = 0;
  if (header.encoder_method == draco::MESH_EDGEBREAKER_ENCODING) buffer.Decode(&traversal);
  for (int i = 0; i < 2; ++i) {  // faces and points, in either order
    uint32_t claimed = 0;
    if (!draco::DecodeVarint(&claimed, &buffer) || claimed > kMaxDeflateRatio * bytes.size()) {
      throw InputError(
          fmt::format("Draco's mesh claims {} faces or points, more than {} bytes hold", claimed,
                      bytes.size()));
    }
  }
}

float LargestOf(draco::DataType type) {
  switch (type) {
    case draco::DT_INT8:
      return INT8_MAX;
    case draco::DT_UINT8:
      return UINT8_MAX;
    case draco::DT_INT16:
      return INT16_MAX;
    case draco::DT_UINT16:
      return UINT16_MAX;
    default:
      return 1;
  }
}

VertexNumbers NumbersOf(const draco::Mesh& mesh, const DracoAttribute& wanted) {
  const draco::PointAttribute* const attribute = mesh.GetAttributeByUniqueId(wanted.id);
  if (attribute == nullptr ||
      static_cast<size_t>(attribute->num_components()) < wanted.components) {
    throw InputError(fmt::format("Draco's mesh has no attribute {} of {} numbers", wanted.id,
                                 wanted.components));
  }
  VertexNumbers numbers{wanted.components, {}};
  numbers.values.resize(numbers.components * mesh.num_points());
  bool is_read = true;
  for (uint32_t i = 0; i < mesh.num_points(); ++i) {
    is_read &= attribute->ConvertValue(attribute->mapped_index(draco::PointIndex(i)),
                                       static_cast<int8_t>(numbers.components),
                                       &numbers.values[i * numbers.components]);
  }
  if (!is_read) throw InputError(fmt::format("Draco's attribute {} is damaged", wanted.id));
  if (wanted.is_normalized && !attribute->normalized()) {
    for (float& value : numbers.values) value /= LargestOf(attribute->data_type());
  }
  return numbers;
}

std::unique_ptr<draco::Mesh> Decoded(std::string_view bytes) {
  try {
    draco::DecoderBuffer buffer = BufferOf(bytes);
    auto decoded = draco::Decoder().DecodeMeshFromBuffer(&buffer);
    if (decoded.ok()) return std::move(decoded).value();
    throw InputError(fmt::format("expected a mesh that Draco compressed: {}",
                                 decoded.status().error_msg_string()));
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const InputError&) {
    throw;
  } catch (const std::exception& error) {
    throw InputError(fmt::format("expected a mesh that Draco compressed: {}", error.what()));
  }
}

}  // namespace

DracoMesh DecodeDraco(std::string_view bytes, std::span<const DracoAttribute> attributes) {
  CheckDracoClaims(bytes);
  const std::unique_ptr<draco::Mesh> mesh = Decoded(bytes);
  DracoMesh decoded;
  for (const DracoAttribute& wanted : attributes) {
    decoded.attributes.push_back(NumbersOf(*mesh, wanted));
  }
  decoded.corners.reserve(size_t{3} * mesh->num_faces());
  for (uint32_t i = 0; i < mesh->num_faces(); ++i) {
    for (const draco::PointIndex& corner : mesh->face(draco::FaceIndex(i))) {
      decoded.corners.push_back(corner.value());
    }
  }
  return decoded;
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
  if (!is_vertices && view.filter != "NONE") throw InputError("only ATTRIBUTES have a filter");
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
