#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "base/bytes.h"
#include "surfaces/file_readers.h"
#include "surfaces/input_files.h"
#include "surfaces/raw_mesh.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/scene/image.h"

namespace raylift {
namespace {

// ---- values ----

// Says what is wrong at the cursor; the element loop adds where.
struct ValueError {
  std::string message;
};

[[noreturn]] void FailAtEnd() { throw ValueError{"the file ends early"}; }

template <bool kSwapBytes>
class BinaryCursor {
 public:
  explicit BinaryCursor(std::string_view bytes)
      : next_(bytes.data()), end_(bytes.data() + bytes.size()) {}

  double Read(PlyType type) {
    return WithPlyValue(type,
                        [&](auto value) { return static_cast<double>(Take<decltype(value)>()); });
  }

  size_t remaining_bytes() const { return static_cast<size_t>(end_ - next_); }
  static size_t MinBytes(PlyType type) { return SizeOf(type); }

 private:
  template <typename T>
  T Take() {
    if (remaining_bytes() < sizeof(T)) FailAtEnd();
    const T value = LoadNumber<T>(next_, kSwapBytes);
    next_ += sizeof(T);
    return value;
  }

  const char* next_;
  const char* end_;
};

class AsciiCursor {
 public:
  explicit AsciiCursor(std::string_view text) : text_(text) {}

  double Read(PlyType) {
    while (!text_.empty() && IsSpace(text_.front())) text_.remove_prefix(1);
    if (text_.empty()) FailAtEnd();
    size_t size = 0;
    while (size < text_.size() && !IsSpace(text_[size])) ++size;
    const auto value = ParseDouble(text_.substr(0, size));
    if (!value) {
      throw ValueError{
          fmt::format("expected a number, found \"{}\"", Shown(text_.substr(0, size)))};
    }
    text_.remove_prefix(size);
    return *value;
  }

  size_t remaining_bytes() const { return text_.size() + 1; }  // the last needs no separator
  static size_t MinBytes(PlyType) { return 2; }                // a digit and a separator

 private:
  static bool IsSpace(char c) { return c == ' ' || c == '\n' || c == '\r' || c == '\t'; }

  std::string_view text_;
};

// ---- elements ----

// The number of a vertex that a property holds.
enum VertexSlot {
  kX,
  kY,
  kZ,
  kRed,
  kGreen,
  kBlue,
  kU,
  kV,
  kNormalX,
  kNormalY,
  kNormalZ,
  kNumVertexSlots
};

std::optional<VertexSlot> SlotOf(std::string_view name) {
  static constexpr std::pair<std::string_view, VertexSlot> kNames[] = {{"x", kX},
                                                                       {"y", kY},
                                                                       {"z", kZ},
                                                                       {"red", kRed},
                                                                       {"green", kGreen},
                                                                       {"blue", kBlue},
                                                                       {"r", kRed},
                                                                       {"g", kGreen},
                                                                       {"b", kBlue},
                                                                       {"diffuse_red", kRed},
                                                                       {"diffuse_green", kGreen},
                                                                       {"diffuse_blue", kBlue},
                                                                       {"u", kU},
                                                                       {"v", kV},
                                                                       {"s", kU},
                                                                       {"t", kV},
                                                                       {"texture_u", kU},
                                                                       {"texture_v", kV},
                                                                       {"nx", kNormalX},
                                                                       {"ny", kNormalY},
                                                                       {"nz", kNormalZ},
                                                                       {"normal_x", kNormalX},
                                                                       {"normal_y", kNormalY},
                                                                       {"normal_z", kNormalZ}};
  for (const auto& [known, slot] : kNames) {
    if (known == name) return slot;
  }
  return std::nullopt;
}

// Returns the full intensity of a color of this type.
double ColorRange(PlyType type) {
  if (type == PlyType::kFloat || type == PlyType::kDouble) return 1;
  return SizeOf(type) == 2 ? 65535 : 255;
}

uint8_t ColorByte(double value, PlyType type) {
  return NearestByte(value / ColorRange(type) * 255);
}

// Throws where a header claims more than its file can hold.
template <typename Cursor>
void CheckCount(const std::filesystem::path& path, const PlyElement& element,
                const Cursor& cursor) {
  size_t min_bytes = 0;
  for (const PlyProperty& property : element.properties) {
    min_bytes += Cursor::MinBytes(property.count_type.value_or(property.type));
  }
  if (min_bytes == 0 ? element.count > 0 : element.count > cursor.remaining_bytes() / min_bytes) {
    throw InputError(
        path, fmt::format("element {}", element.name),
        fmt::format("the header claims {} of them, the file has room for {}", element.count,
                    min_bytes == 0 ? 0 : cursor.remaining_bytes() / min_bytes));
  }
}

template <typename Cursor>
class ElementReader {
 public:
  ElementReader(const std::filesystem::path& path, const PlyHeader& header, Cursor cursor,
                RawMesh& mesh)
      : path_(path), header_(header), cursor_(cursor), mesh_(mesh) {}

  void ReadAll() {
    bool has_vertices = false;
    for (const PlyElement& element : header_.elements) {
      CheckCount(path_, element, cursor_);
      if (element.name == "vertex") {
        ReadVertices(element);
        has_vertices = true;
      } else if (element.name == "face") {
        if (!has_vertices) {
          throw InputError(path_, "header", "expected the element vertex before the element face");
        }
        ReadFaces(element);
      } else {
        ForEach(element, [&](uint64_t) {
          for (const PlyProperty& property : element.properties) Skip(property);
        });
      }
    }
  }

 private:
  bool HasFaces() const {
    return std::any_of(
        header_.elements.begin(), header_.elements.end(),
        [](const PlyElement& element) { return element.name == "face" && element.count > 0; });
  }

  // Calls body(i) for each entry of the element; names the entry where a value is wrong.
  template <typename Body>
  void ForEach(const PlyElement& element, const Body& body) {
    uint64_t i = 0;
    try {
      for (; i < element.count; ++i) body(i);
    } catch (const ValueError& error) {
      throw InputError(path_, fmt::format("{} {} of {}", element.name, i, element.count),
                       error.message);
    }
  }

  uint64_t ReadListSize(const PlyProperty& property) {
    const double size = cursor_.Read(*property.count_type);
    if (!(size >= 0) || size != std::floor(size)) {
      throw ValueError{
          fmt::format("expected the length of list {}, found {}", property.name, size)};
    }
    const size_t room = cursor_.remaining_bytes() / Cursor::MinBytes(property.type);
    if (size > static_cast<double>(room)) FailAtEnd();
    return static_cast<uint64_t>(size);
  }

  void Skip(const PlyProperty& property) {
    const uint64_t count = property.count_type ? ReadListSize(property) : 1;
    for (uint64_t i = 0; i < count; ++i) cursor_.Read(property.type);
  }

  void ReadVertices(const PlyElement& element) {
    std::array<std::optional<PlyType>, kNumVertexSlots> types;
    std::vector<std::optional<VertexSlot>> slots;
    for (const PlyProperty& property : element.properties) {
      slots.push_back(property.count_type ? std::nullopt : SlotOf(property.name));
      if (slots.back()) types[*slots.back()] = property.type;
    }
    if (!types[kX] || !types[kY] || !types[kZ]) {
      throw InputError(path_, "element vertex", "expected the properties x, y and z");
    }
    if (element.count >= RawMesh::kNone) {
      throw InputError(path_, "element vertex",
                       fmt::format("{} vertices are too many", element.count));
    }
    const bool has_colors = types[kRed] && types[kGreen] && types[kBlue];
    const bool has_uvs = types[kU] && types[kV];
    const bool has_normals = types[kNormalX] && types[kNormalY] && types[kNormalZ] && !HasFaces();
    mesh_.positions.reserve(element.count);
    if (has_colors) mesh_.position_colors.reserve(element.count);
    if (has_uvs) mesh_.uvs.reserve(element.count);
    std::array<double, kNumVertexSlots> values{};
    ForEach(element, [&](uint64_t) {
      for (size_t i = 0; i < slots.size(); ++i) {
        if (slots[i]) {
          values[*slots[i]] = cursor_.Read(element.properties[i].type);
        } else {
          Skip(element.properties[i]);
        }
      }
      mesh_.positions.emplace_back(values[kX], values[kY], values[kZ]);
      if (has_colors) {
        mesh_.position_colors.push_back({ColorByte(values[kRed], *types[kRed]),
                                         ColorByte(values[kGreen], *types[kGreen]),
                                         ColorByte(values[kBlue], *types[kBlue])});
      }
      if (has_normals) {
        mesh_.position_normals.push_back(
            Eigen::Vector3d(values[kNormalX], values[kNormalY], values[kNormalZ]).cast<float>());
      }
      if (has_uvs) {
        mesh_.uvs.emplace_back(static_cast<float>(values[kU]), static_cast<float>(values[kV]));
      }
    });
  }

  void ReadFaces(const PlyElement& element) {
    const auto find = [&](std::string_view name) -> const PlyProperty* {
      for (const PlyProperty& property : element.properties) {
        if (property.name == name) return &property;
      }
      return nullptr;
    };
    const PlyProperty* indices = find("vertex_indices");
    if (indices == nullptr) indices = find("vertex_index");
    if (indices == nullptr || !indices->count_type) {
      throw InputError(path_, "element face", "expected the list vertex_indices");
    }
    const PlyProperty* texcoords = find("texcoord");
    if (texcoords != nullptr && !texcoords->count_type) texcoords = nullptr;
    const PlyProperty* texnumber = find("texnumber");
    if (texnumber != nullptr && texnumber->count_type) texnumber = nullptr;
    if (texcoords != nullptr) mesh_.uvs.clear();  // the corners' own are finer
    const size_t num_materials = mesh_.materials.size();
    mesh_.triangles.reserve(element.count);

    uint64_t too_small = 0;
    std::vector<uint32_t> corners;
    std::vector<uint32_t> corner_uvs;
    ForEach(element, [&](uint64_t face) {
      corners.clear();
      corner_uvs.clear();
      double texture = 0;
      for (const PlyProperty& property : element.properties) {
        if (&property == indices) {
          ReadCorners(property, corners);
        } else if (&property == texcoords) {
          ReadTexcoords(property, corner_uvs);
        } else if (&property == texnumber) {
          texture = cursor_.Read(property.type);
        } else {
          Skip(property);
        }
      }
      if (corners.size() < 3) {
        ++too_small;
        return;
      }
      if (texcoords != nullptr) corner_uvs.resize(corners.size(), RawMesh::kNone);
      const size_t added = AddFace(face, corners, corner_uvs, mesh_);
      if (num_materials > 0) {
        const bool known = texture >= 0 && texture < static_cast<double>(num_materials);
        mesh_.triangle_materials.insert(mesh_.triangle_materials.end(), added,
                                        known ? static_cast<uint32_t>(texture) : RawMesh::kNone);
      }
    });
    if (too_small > 0) {
      mesh_.warnings.push_back(fmt::format("{}: {} of {} faces skipped: fewer than three corners",
                                           path_.string(), too_small, element.count));
    }
  }

  void ReadCorners(const PlyProperty& property, std::vector<uint32_t>& corners) {
    const uint64_t count = ReadListSize(property);
    for (uint64_t k = 0; k < count; ++k) {
      const double index = cursor_.Read(property.type);
      if (!(index >= 0 && index < static_cast<double>(mesh_.positions.size())) ||
          index != std::floor(index)) {
        throw ValueError{fmt::format("expected a vertex index below {}, found {}",
                                     mesh_.positions.size(), index)};
      }
      corners.push_back(static_cast<uint32_t>(index));
    }
  }

  void ReadTexcoords(const PlyProperty& property, std::vector<uint32_t>& corner_uvs) {
    const uint64_t count = ReadListSize(property);
    for (uint64_t k = 0; k + 1 < count; k += 2) {
      const auto u = static_cast<float>(cursor_.Read(property.type));
      const auto v = static_cast<float>(cursor_.Read(property.type));
      corner_uvs.push_back(static_cast<uint32_t>(mesh_.uvs.size()));
      mesh_.uvs.emplace_back(u, v);
    }
    if (count % 2 == 1) cursor_.Read(property.type);
  }

  const std::filesystem::path& path_;
  const PlyHeader& header_;
  Cursor cursor_;
  RawMesh& mesh_;
};

template <typename Cursor>
void ReadElements(const std::filesystem::path& path, const PlyHeader& header, std::string_view body,
                  RawMesh& mesh) {
  ElementReader<Cursor>(path, header, Cursor(body), mesh).ReadAll();
}

}  // namespace

RawMesh ReadPly(const std::filesystem::path& path, const PlyHeader& header,
                std::string_view contents) {
  RawMesh mesh;
  for (const std::string& name : header.texture_files) {
    mesh.materials.push_back({AddTextureFile(path, name, mesh), std::nullopt});
  }
  const std::string_view body = contents.substr(header.size_bytes);
  constexpr bool kLittleHost = std::endian::native == std::endian::little;
  switch (header.format) {
    case PlyHeader::Format::kAscii:
      ReadElements<AsciiCursor>(path, header, body, mesh);
      break;
    case PlyHeader::Format::kLittleEndian:
      ReadElements<BinaryCursor<!kLittleHost>>(path, header, body, mesh);
      break;
    case PlyHeader::Format::kBigEndian:
      ReadElements<BinaryCursor<kLittleHost>>(path, header, body, mesh);
      break;
  }
  return mesh;
}

}  // namespace raylift
