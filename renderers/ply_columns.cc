#include "ply_columns.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

size_t RowBytes(const std::filesystem::path& path, const PlyElement& element) {
  size_t bytes = 0;
  for (const PlyProperty& property : element.properties) {
    if (property.count_type) {
      throw InputError(path, fmt::format("element {}", element.name),
                       fmt::format("expected single numbers, found the list {}", property.name));
    }
    bytes += SizeOf(property.type);
  }
  return bytes;
}

}  // namespace

PlyColumns::PlyColumns(const std::filesystem::path& path, const PlyHeader& header,
                       std::string_view contents, std::string_view name)
    : path_(path),
      swap_bytes_((header.format == PlyHeader::Format::kBigEndian) !=
                  (std::endian::native == std::endian::big)) {
  if (header.format == PlyHeader::Format::kAscii) {
    throw InputError(path, "header", "expected format binary_little_endian, found ascii");
  }
  contents.remove_prefix(header.size_bytes);
  for (const PlyElement& element : header.elements) {
    const size_t row_bytes = RowBytes(path, element);
    const uint64_t room = row_bytes == 0 ? 0 : contents.size() / row_bytes;
    if (element.count > room) {
      throw InputError(path, fmt::format("element {}", element.name),
                       fmt::format("the header claims {} of them, the file has room for {}",
                                   element.count, room));
    }
    if (element.name == name) {
      element_ = element;
      row_bytes_ = row_bytes;
      num_rows_ = element.count;
      rows_ = contents.substr(0, num_rows_ * row_bytes);
      return;
    }
    contents.remove_prefix(element.count * row_bytes);
  }
  throw InputError(path, "header", fmt::format("expected the element {}", name));
}

std::optional<PlyColumns::Column> PlyColumns::Find(std::string_view property) const {
  size_t offset = 0;
  for (const PlyProperty& known : element_.properties) {
    if (known.name == property) return Column{offset, known.type};
    offset += SizeOf(known.type);
  }
  return std::nullopt;
}

PlyColumns::Column PlyColumns::Get(std::string_view property) const {
  const auto column = Find(property);
  if (!column) {
    throw InputError(path_, fmt::format("element {}", element_.name),
                     fmt::format("expected the property {}", property));
  }
  return *column;
}

PlyColumns::Column PlyColumns::Get(std::string_view property, PlyType type) const {
  const Column column = Get(property);
  if (column.type != type) {
    throw InputError(path_, fmt::format("element {}, {}", element_.name, property),
                     "is not of the type that this layout has");
  }
  return column;
}

template <typename T>
T PlyColumns::Load(const char* from) const {
  std::array<char, sizeof(T)> bytes;
  std::memcpy(bytes.data(), from, sizeof(T));
  if (swap_bytes_) std::reverse(bytes.begin(), bytes.end());
  return std::bit_cast<T>(bytes);
}

double PlyColumns::At(size_t row, const Column& column) const {
  using enum PlyType;
  const char* const from = rows_.data() + row * row_bytes_ + column.offset;
  switch (column.type) {
    case kInt8:
      return Load<int8_t>(from);
    case kUint8:
      return Load<uint8_t>(from);
    case kInt16:
      return Load<int16_t>(from);
    case kUint16:
      return Load<uint16_t>(from);
    case kInt32:
      return Load<int32_t>(from);
    case kUint32:
      return Load<uint32_t>(from);
    case kFloat:
      return double{Load<float>(from)};
    case kDouble:
      return Load<double>(from);
  }
  return 0;
}

}  // namespace raylift
