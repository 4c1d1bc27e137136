// The header of a PLY file: which elements follow, in what form.

#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

size_t SizeOf(PlyType type);

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

// `contents` is the whole file; `path` is for messages. InputError where it is no PLY header.
PlyHeader ParsePlyHeader(const std::filesystem::path& path, std::string_view contents);

}  // namespace raylift
