// Reads the parts of a glTF 2 file: its JSON, its buffers, the numbers of its accessors, compressed
// data, and its nodes.

#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <initializer_list>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "io/text/json_document.h"
#include "surfaces/file_readers.h"
#include "surfaces/input_files.h"
#include <Eigen/Geometry>

namespace raylift {

// Decompresses glTF's Draco (KHR_draco_mesh_compression) and meshoptimizer
// (EXT_meshopt_compression) data.

// An attribute of vertices: `components` numbers of each, one vertex after the other.
struct VertexNumbers {
  size_t components = 0;
  std::vector<float> values;

  size_t count() const { return components == 0 ? 0 : values.size() / components; }
};

// The attribute that is to be read from a mesh that Draco compressed.
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

// The members of EXT_meshopt_compression.
struct MeshoptView {
  std::string mode;
  std::string filter;
  size_t count;
  size_t stride;
};

// Returns count * stride bytes. Throws InputError where the compressed ones are not what is said.
std::string DecodeMeshopt(std::string_view bytes, const MeshoptView& view);

// Calls `use` with the member of a member ... that the names lead to, if there is one.
template <typename Use>
void IfThere(const JsonPlace& place, std::initializer_list<std::string_view> names, const Use& use,
             size_t next = 0) {
  if (next == names.size()) return use(place);
  const std::string_view name = names.begin()[next];
  if (!place.Has(name)) return;
  const JsonPlace member = place.Member(name);
  IfThere(member, names, use, next + 1);
}

// Returns a number of bytes or items up to 2^32 - 1, or `missing` where there is no such member.
uint64_t CountOf(const JsonPlace& place, std::string_view member, uint64_t missing);

// Returns the numbers of a member, or `missing` where there is none.
template <int N>
Eigen::Matrix<double, N, 1> VectorOr(const JsonPlace& place, std::string_view member,
                                     const Eigen::Matrix<double, N, 1>& missing) {
  if (!place.Has(member)) return missing;
  const JsonPlace vector = place.Member(member);
  return vector.Vector<N>();
}

// Returns a vertex's numbers of an attribute with N components.
template <int N>
Eigen::Matrix<double, N, 1> ItemOf(const VertexNumbers& numbers, size_t index) {
  return Eigen::Map<const Eigen::Matrix<float, N, 1>>(&numbers.values[N * index])
      .template cast<double>();
}

// A glTF file. Data are checked when they are read: the members throw InputError that names file
// and JSON path.
class GltfFile {
 public:
  // `contents` must outlive the object.
  GltfFile(const std::filesystem::path& path, std::string_view contents, GltfPlace place);

  const JsonPlace& root() const { return root_; }
  size_t CountItems(const std::string& list) const;
  JsonPlace Item(const std::string& list, size_t index) const;
  // Returns the index of an item of a list that stands at a place.
  size_t Index(const std::string& list, const JsonPlace& index) const;

  // Returns the bytes of a buffer view, decompressed where they must be; valid as long as the file
  // is.
  std::string_view BytesOfView(const JsonPlace& index);

  // Reads the items of an accessor, each of `components` numbers; 0 stands for as many as it has, 3
  // or 4. Normalized integers become numbers up to 1.
  VertexNumbers ReadNumbers(const JsonPlace& index, size_t components);
  // Reads the accessor that a member names; returns no numbers where there is no such member.
  VertexNumbers ReadAttribute(const JsonPlace& attributes, std::string_view name,
                              size_t components);
  // Reads unsigned integers.
  std::vector<uint32_t> ReadIndices(const JsonPlace& index);

  // Returns what a URI holds that carries its data itself; nullopt where it names a file, whose
  // place may be read.
  std::optional<std::string> DataOfUri(const JsonPlace& uri) const;

 private:
  struct View {
    std::string_view bytes;
    size_t stride;  // 0: items lie one after the other
  };
  struct Items;

  std::string_view TakeJson();
  std::string_view TakeChunk(std::string_view name);
  const View& ViewAt(const JsonPlace& index);
  std::string_view PartOfBuffer(const JsonPlace& place);
  std::string_view Buffer(size_t index);
  uint64_t NumBytes() const;  // of the file and the buffers that were read
  std::string_view ReadBuffer(size_t index);
  Items AtPlace(const JsonPlace& place, Items items);
  Items ItemsOf(const JsonPlace& accessor, size_t components);
  template <typename Number>
  std::vector<Number> Read(const JsonPlace& accessor, const Items& items);

  const std::filesystem::path path_;
  GltfPlace place_;
  size_t size_bytes_;
  std::string_view rest_;                 // of binary files, behind the chunks that were taken
  std::optional<std::string_view> data_;  // the second chunk
  JsonDocument document_;
  JsonPlace root_;
  std::map<std::string, JsonPlace> lists_;
  std::map<size_t, std::string_view> buffers_;
  std::map<size_t, View> views_;
  std::deque<std::string> decoded_;  // what buffers and views point into
  uint64_t num_decompressed_ = 0;    // bytes that views decompressed
  std::deque<MappedFile> files_;
};

// Reads the tree of a file's nodes, which place its meshes.

// A mesh of the file where a node (or an instance of it) puts it.
struct GltfInstance {
  size_t index;
  Eigen::Affine3d root_from_mesh;
  std::string name;  // PartName()
};

// Returns the meshes of the shown scene in the order of its tree, those of instanced nodes
// (EXT_mesh_gpu_instancing) once for each, and all of them for each of `copies`, if there are any.
// `z_up_from_gltf` turns the axes of CESIUM_RTC's center. Throws InputError where nodes are no tree
// or too many.
std::vector<GltfInstance> PlaceMeshes(const std::filesystem::path& path, GltfFile& file,
                                      const Eigen::Matrix3d& z_up_from_gltf,
                                      std::span<const Eigen::Affine3d> copies);

[[noreturn]] void FailOfManyMeshes(const std::filesystem::path& path);

}  // namespace raylift
