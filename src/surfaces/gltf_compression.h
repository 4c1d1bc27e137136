// What compresses glTF: Draco (KHR_draco_mesh_compression) and meshoptimizer
// (EXT_meshopt_compression).

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

// An attribute of vertices: `components` numbers of each, one vertex after the other.
struct VertexNumbers {
  size_t components = 0;
  std::vector<float> values;

  size_t count() const { return components == 0 ? 0 : values.size() / components; }
};

// What is wanted of a mesh that Draco compressed.
struct DracoAttribute {
  uint32_t id;
  size_t components;
  bool is_normalized;  // integers stand for their share of the largest one
};

struct DracoMesh {
  std::vector<VertexNumbers> attributes;  // as they were asked for
  std::vector<uint32_t> corners;          // of triangles
};

// Throws InputError where the bytes are no such mesh, or claim more than they can hold.
DracoMesh DecodeDraco(std::string_view bytes, std::span<const DracoAttribute> attributes);

// More bytes of one never come out: 16 vertices whose bytes do not change take two bits, a triangle
// of three indices one byte.
inline constexpr size_t kMostMeshoptRatio = 64;

// The members of EXT_meshopt_compression.
struct MeshoptView {
  std::string mode;
  std::string filter;
  size_t count;
  size_t stride;
};

// Returns count * stride bytes. Throws InputError where the compressed ones are not what is said.
std::string DecodeMeshopt(std::string_view bytes, const MeshoptView& view);

}  // namespace raylift
