// The files of tiles: glTF, alone or in b3dm (with what its features say), and several of them in
// cmpt.

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <string_view>
#include <utility>

#include "base/input_paths.h"
#include "io/text/json_document.h"
#include "surfaces/file_readers.h"
#include "surfaces/input_files.h"
#include "surfaces/tileset.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using Eigen::Affine3d;
using Eigen::Vector3d;

constexpr int kMaxTilesInTiles = 16;

void Move(const Affine3d& root_from_gltf, RawMesh& mesh) {
  for (Vector3d& position : mesh.positions) position = root_from_gltf * position;
  if (root_from_gltf.linear().determinant() > 0) return;
  for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
}

class TileReader {
 public:
  explicit TileReader(const TileContent& content) : content_(content) {}

  TileMeshes Read() {
    const MappedFile file(content_.file);
    const std::string_view bytes = file.contents();
    const std::string extension = LowerExtension(content_.file);
    if (extension == ".gltf" || (extension == ".glb" && bytes.starts_with("glTF"))) {
      Add(ReadGltf(content_.file, bytes, GltfPlace::kFile, content_.z_up_from_gltf),
          Vector3d::Zero());
    } else {
      ReadTile(bytes, 0);
    }
    return std::move(meshes_);
  }

 private:
  [[noreturn]] void FailTruncated() const {
    throw InputError(content_.file, "the file is damaged or truncated");
  }

  // A magic word, the version and the whole size, which all of these begin with.
  static constexpr size_t kCommonHeader = 12;

  uint32_t Number(std::string_view bytes, size_t offset) const {
    uint32_t number = 0;
    if (bytes.size() < offset + sizeof(number)) FailTruncated();
    std::memcpy(&number, bytes.data() + offset, sizeof(number));
    return number;
  }

  void ReadTile(std::string_view bytes, int depth) {
    if (depth > kMaxTilesInTiles) {
      throw InputError(content_.file, fmt::format("tiles in tiles are nested more than {} deep",
                                                  kMaxTilesInTiles));
    }
    const std::string_view kind = bytes.substr(0, 4);
    const auto is = [&](std::string_view name) { return kind == name; };
    if (!is("glTF") && !is("b3dm") && !is("cmpt") && !is("i3dm") && !is("pnts")) {
      throw InputError(content_.file,
                       fmt::format("expected a tile (b3dm, cmpt, glb or gltf), found "
                                   "a file that begins with \"{}\"",
                                   Shown(kind)));
    }
    const uint32_t size = Number(bytes, 8);
    if (size > bytes.size() || size < kCommonHeader) FailTruncated();
    bytes = bytes.substr(0, size);
    if (is("glTF")) AddPart(bytes, Vector3d::Zero());
    if (is("b3dm")) ReadBatched(bytes);
    if (is("cmpt")) ReadComposite(bytes, depth);
    meshes_.num_instanced += is("i3dm") ? 1 : 0;
    meshes_.num_clouds += is("pnts") ? 1 : 0;
  }

  void ReadComposite(std::string_view bytes, int depth) {
    const uint32_t count = Number(bytes, kCommonHeader);
    std::string_view rest = bytes.substr(kCommonHeader + 4);
    for (uint32_t i = 0; i < count; ++i) {
      const uint32_t size = Number(rest, 8);
      if (size > rest.size() || size < kCommonHeader) FailTruncated();
      ReadTile(rest.substr(0, size), depth + 1);
      rest.remove_prefix(size);
    }
  }

  // Tables of features and of batches, JSON and bytes each, and then glTF.
  void ReadBatched(std::string_view bytes) {
    std::array<uint32_t, 4> sizes{};
    for (size_t i = 0; i < sizes.size(); ++i) sizes[i] = Number(bytes, kCommonHeader + 4 * i);
    std::string_view rest = bytes.substr(kCommonHeader + 4 * sizes.size());
    std::array<std::string_view, 4> tables;
    for (size_t i = 0; i < sizes.size(); ++i) {
      if (sizes[i] > rest.size()) FailTruncated();
      tables[i] = rest.substr(0, sizes[i]);
      rest.remove_prefix(sizes[i]);
    }
    if (!rest.starts_with("glTF")) {
      throw InputError(content_.file, "expected binary glTF after the tables of the tile");
    }
    AddPart(rest.substr(0, std::min<size_t>(rest.size(), Number(rest, 8))),
            CenterOf(tables[0], tables[1]));
  }

  // RTC_CENTER: three numbers, or where they are as floats.
  Vector3d CenterOf(std::string_view features, std::string_view binary) const {
    if (features.find('{') == std::string_view::npos) return Vector3d::Zero();
    const JsonDocument document(features, content_.file);
    const JsonPlace root = document.Root();
    if (!root.Has("RTC_CENTER")) return Vector3d::Zero();
    const JsonPlace center = root.Member("RTC_CENTER");
    if (center.IsArray()) return center.Vector<3>();
    const JsonPlace place = center.Member("byteOffset");
    const int offset = place.Int();
    Eigen::Vector3f numbers;
    if (offset < 0 || static_cast<size_t>(offset) + sizeof(numbers) > binary.size()) {
      place.Fail(fmt::format("expected three floats in {} bytes", binary.size()));
    }
    std::memcpy(numbers.data(), binary.data() + offset, sizeof(numbers));
    return numbers.cast<double>();
  }

  void AddPart(std::string_view glb, const Vector3d& center) {
    Add(ReadGltf(content_.file, glb, GltfPlace::kPartOfFile, content_.z_up_from_gltf), center);
  }

  void Add(RawMesh mesh, const Vector3d& center) {
    Move(content_.root_from_tile * Eigen::Translation3d(center) * Affine3d(content_.z_up_from_gltf),
         mesh);
    if (!mesh.triangles.empty()) meshes_.meshes.push_back(std::move(mesh));
  }

  const TileContent& content_;
  TileMeshes meshes_;
};

}  // namespace

TileMeshes ReadTileContent(const TileContent& content) { return TileReader(content).Read(); }

}  // namespace raylift
