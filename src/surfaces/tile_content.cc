// Reads the files of tiles: glTF, alone, in b3dm or many times in i3dm (with the positions of its
// features), and several of them in cmpt.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>
#include <utility>

#include "base/bytes.h"
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

// Returns unit vectors from points of an octahedron (Cigolle et al. 2014, Section 3.3).
std::vector<double> FromOct(const std::vector<double>& numbers) {
  std::vector<double> vectors;
  for (size_t i = 0; i + 1 < numbers.size(); i += 2) {
    const double x = 2 * numbers[i] / UINT16_MAX - 1, y = 2 * numbers[i + 1] / UINT16_MAX - 1;
    Vector3d v(x, y, 1 - std::abs(x) - std::abs(y));
    if (v.z() < 0) {
      v.head<2>() << std::copysign(1 - std::abs(y), x), std::copysign(1 - std::abs(x), y);
    }
    v.normalize();
    vectors.insert(vectors.end(), v.begin(), v.end());
  }
  return vectors;
}

// Returns the axes east, north and up of WGS 84's ellipsoid.
Eigen::Matrix3d EastNorthUp(const Vector3d& place) {
  constexpr double kA = 6378137, kB = 6356752.314245179;
  Eigen::Matrix3d axes;
  const Vector3d up = place.cwiseQuotient(Vector3d(kA * kA, kA * kA, kB * kB)).normalized();
  const bool is_pole = place.head<2>().isZero(0);
  const Vector3d east =
      is_pole ? Vector3d::UnitY() : Vector3d(-place.y(), place.x(), 0).normalized();
  axes << east, up.cross(east), up;
  return axes;
}

// Reads the feature table of a tile: data on itself and on its instances.
class FeatureTable {
 public:
  // Both must outlive it.
  FeatureTable(const JsonPlace& root, std::string_view binary) : root_(root), binary_(binary) {}

  Vector3d Center() const {
    return root_.Has("RTC_CENTER") ? CartesianOf("RTC_CENTER") : Vector3d::Zero();
  }

  // Returns where each instance stands, in the axes of the glTF.
  std::vector<Affine3d> InstancePlaces(const Eigen::Matrix3d& z_up_from_gltf) const {
    const JsonPlace length = root_.Member("INSTANCES_LENGTH");
    const double claimed =
        length.IsNumber() ? length.Number() : Features("INSTANCES_LENGTH", uint32_t{}, 1)[0];
    if (!(claimed >= 0 && claimed <= UINT32_MAX)) length.Fail("expected a number of instances");
    const auto count = static_cast<size_t>(claimed);
    const auto read = [&](std::string_view name, auto number, size_t components) {
      return Features(name, number, count * components);
    };
    std::vector<double> positions = read("POSITION", float{}, 3);
    if (positions.empty()) {
      positions = Dequantized(read("POSITION_QUANTIZED", uint16_t{}, 3));
    }
    std::vector<double> up = read("NORMAL_UP", float{}, 3),
                        right = read("NORMAL_RIGHT", float{}, 3);
    if (up.empty()) up = FromOct(read("NORMAL_UP_OCT32P", uint16_t{}, 2));
    if (right.empty()) right = FromOct(read("NORMAL_RIGHT_OCT32P", uint16_t{}, 2));
    const std::vector<double> scale = read("SCALE", float{}, 1);
    const std::vector<double> scales = read("SCALE_NON_UNIFORM", float{}, 3);
    const bool is_on_earth = root_.Has("EAST_NORTH_UP") && root_.Member("EAST_NORTH_UP").Bool();
    if (positions.empty() && count > 0) root_.Fail("expected POSITION or POSITION_QUANTIZED");
    if (up.empty() != right.empty()) root_.Fail("expected NORMAL_UP and NORMAL_RIGHT, or neither");
    const Vector3d center = Center();
    std::vector<Affine3d> places;
    for (size_t i = 0; i < count; ++i) {
      const auto item = [&](const std::vector<double>& v) { return Vector3d(&v[3 * i]); };
      Affine3d place(Eigen::Translation3d(item(positions)));
      if (!up.empty()) {
        place.linear() << item(right), item(up), item(right).cross(item(up));
      } else if (is_on_earth) {
        place.linear() = EastNorthUp(center + item(positions));
      }
      if (!scales.empty()) place.scale(item(scales));
      if (!scale.empty()) place.scale(scale[i]);
      const Affine3d z_up(z_up_from_gltf);
      places.push_back(z_up.inverse() * place * z_up);
    }
    return places;
  }

 private:
  // Returns `count` numbers of a feature; none where the tile does not have it.
  template <typename T>
  std::vector<double> Features(std::string_view name, T number, size_t count) const {
    if (!root_.Has(name)) return {};
    const JsonPlace feature = root_.Member(name);
    const JsonPlace place = feature.Member("byteOffset");
    const int offset = place.Int();
    if (offset < 0 || static_cast<size_t>(offset) > binary_.size() ||
        count > (binary_.size() - static_cast<size_t>(offset)) / sizeof(T)) {
      place.Fail(fmt::format("expected {} numbers in {} bytes", count, binary_.size()));
    }
    std::vector<double> numbers(count);
    for (size_t i = 0; i < count; ++i) {
      std::memcpy(&number, binary_.data() + offset + i * sizeof(T), sizeof(T));
      numbers[i] = static_cast<double>(number);
    }
    return numbers;
  }

  std::vector<double> Dequantized(std::vector<double> numbers) const {
    if (numbers.empty()) return numbers;
    const Vector3d low = CartesianOf("QUANTIZED_VOLUME_OFFSET");
    const Vector3d size = CartesianOf("QUANTIZED_VOLUME_SCALE");
    for (size_t i = 0; i < numbers.size(); ++i) {
      const auto axis = static_cast<Eigen::Index>(i % 3);
      numbers[i] = low[axis] + size[axis] * numbers[i] / UINT16_MAX;
    }
    return numbers;
  }

  // Returns the three numbers of a member, which stand there or, as floats, in the binary part.
  Vector3d CartesianOf(std::string_view name) const {
    const JsonPlace place = root_.Member(name);
    if (place.IsArray()) return place.Vector<3>();
    return Vector3d(Features(name, float{}, 3).data());
  }

  const JsonPlace& root_;
  std::string_view binary_;
};

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

  // These begin with a magic word, the version and the whole size.
  static constexpr size_t kCommonHeader = 12;

  uint32_t Number(std::string_view bytes, size_t offset) const {
    if (bytes.size() < offset + sizeof(uint32_t)) FailTruncated();
    return LoadNumber<uint32_t>(bytes.data() + offset);
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
    if (is("glTF")) AddPart(bytes, Vector3d::Zero(), {});
    if (is("b3dm")) ReadBatched(bytes);
    if (is("i3dm")) ReadInstanced(bytes);
    if (is("cmpt")) ReadComposite(bytes, depth);
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

  // Holds the tables of features and of batches, JSON and bytes each, and what follows them.
  struct Parts {
    std::array<std::string_view, 4> tables;
    std::string_view rest;
  };

  Parts PartsOf(std::string_view bytes, size_t header) const {
    Parts parts{{}, bytes.substr(std::min(header, bytes.size()))};
    for (size_t i = 0; i < parts.tables.size(); ++i) {
      const uint32_t size = Number(bytes, kCommonHeader + 4 * i);
      if (size > parts.rest.size()) FailTruncated();
      parts.tables[i] = parts.rest.substr(0, size);
      parts.rest.remove_prefix(size);
    }
    return parts;
  }

  std::string_view GlbIn(std::string_view rest) const {
    if (!rest.starts_with("glTF")) {
      throw InputError(content_.file, "expected binary glTF after the tables of the tile");
    }
    return rest.substr(0, std::min<size_t>(rest.size(), Number(rest, 8)));
  }

  void ReadBatched(std::string_view bytes) {
    const Parts parts = PartsOf(bytes, kCommonHeader + 16);
    const std::string_view glb = GlbIn(parts.rest);
    Vector3d center = Vector3d::Zero();
    if (parts.tables[0].find('{') != std::string_view::npos) {
      const JsonDocument document(parts.tables[0], content_.file);
      const JsonPlace root = document.Root();
      center = FeatureTable(root, parts.tables[1]).Center();
    }
    AddPart(glb, center, {});
  }

  // The header ends with whether glTF follows or the name of its file.
  void ReadInstanced(std::string_view bytes) {
    constexpr size_t kFormat = kCommonHeader + 16;
    const Parts parts = PartsOf(bytes, kFormat + 4);
    const JsonDocument document(parts.tables[0], content_.file);
    const JsonPlace root = document.Root();
    const FeatureTable table(root, parts.tables[1]);
    const std::vector<Affine3d> places = table.InstancePlaces(content_.z_up_from_gltf);
    if (places.empty()) return;
    const Vector3d center = table.Center();
    const uint32_t format = Number(bytes, kFormat);
    if (format > 1) throw InputError(content_.file, "expected the glTF's format 0 or 1");
    if (format == 1) return AddPart(GlbIn(parts.rest), center, places);
    const size_t padding = parts.rest.find_last_not_of(std::string_view("\0 ", 2));
    const std::filesystem::path path = FileOf(std::string(parts.rest.substr(0, padding + 1)));
    const MappedFile file(path);
    Add(ReadGltf(path, file.contents(), GltfPlace::kFile, content_.z_up_from_gltf, places), center);
  }

  std::filesystem::path FileOf(const std::string& uri) const {
    try {
      return ResolveInTileset(uri, content_.file, content_.folder);
    } catch (const InputError& error) {
      throw InputError(content_.file, error.what());
    }
  }

  void AddPart(std::string_view glb, const Vector3d& center, std::span<const Affine3d> copies) {
    Add(ReadGltf(content_.file, glb, GltfPlace::kPartOfFile, content_.z_up_from_gltf, copies),
        center);
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
