// PLY files: the header, and the rows of binary elements.

#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

// Calls body with a value of the type that `type` stands for.
template <typename Body>
auto WithPlyValue(PlyType type, const Body& body) {
  using enum PlyType;
  switch (type) {
    case kInt8:
      return body(int8_t{});
    case kUint8:
      return body(uint8_t{});
    case kInt16:
      return body(int16_t{});
    case kUint16:
      return body(uint16_t{});
    case kInt32:
      return body(int32_t{});
    case kUint32:
      return body(uint32_t{});
    case kFloat:
      return body(float{});
    case kDouble:
      break;
  }
  return body(double{});
}

inline size_t SizeOf(PlyType type) {
  return WithPlyValue(type, [](auto value) { return sizeof(value); });
}

struct PlyProperty {
  std::string name;
  PlyType type;
  std::optional<PlyType> count_type;  // of a list
};

struct PlyElement {
  std::string name;
  uint64_t count = 0;
  std::vector<PlyProperty> properties;
};

struct PlyHeader {
  enum class Format { kAscii, kLittleEndian, kBigEndian };
  Format format = Format::kAscii;
  std::vector<PlyElement> elements;
  std::vector<std::string> texture_files;
  size_t size_bytes = 0;
};

// Parses a header. `contents` is the whole file; `path` is for messages. Throws InputError where it
// is no PLY header.
PlyHeader ParsePlyHeader(const std::filesystem::path& path, std::string_view contents);

// Reads the rows of a binary element, whose properties are all single numbers, by property; these
// may be in any order and of any type.
class PlyColumns {
 public:
  // A property's place in a row.
  struct Column {
    size_t offset;
    PlyType type;
  };

  // Takes the element `name` of a file. Throws InputError where there is none, it or one before
  // it has a list, the file is not binary, or it ends before the last row.
  PlyColumns(const std::filesystem::path& path, const PlyHeader& header, std::string_view contents,
             std::string_view name);

  size_t num_rows() const { return num_rows_; }

  std::optional<Column> Find(std::string_view property) const;
  // Throw InputError where there is none, or it is of another type.
  Column Get(std::string_view property) const;
  Column Get(std::string_view property, PlyType type) const;

  double At(size_t row, const Column& column) const;

 private:
  std::filesystem::path path_;
  PlyElement element_;
  std::string_view rows_;
  size_t num_rows_ = 0;
  size_t row_bytes_ = 0;
  bool swap_bytes_;
};

}  // namespace raylift
