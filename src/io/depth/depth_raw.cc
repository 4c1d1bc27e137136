// Depth maps as plain numbers behind at most a short header of text: floats alone (kapture, ETH3D),
// COLMAP's, PFM and PGM.

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstring>

#include "base/bytes.h"
#include "io/depth/depth_formats.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

// The header "width&height&channels&", which is all that stands before the data.
struct ColmapHeader {
  uint64_t width, height, channels;
  size_t data_offset;
};

std::optional<ColmapHeader> ParseColmapHeader(std::string_view bytes) {
  std::array<uint64_t, 3> numbers;
  size_t position = 0;
  for (uint64_t& number : numbers) {
    const size_t end = bytes.substr(0, position + 20).find('&', position);
    if (end == std::string_view::npos) return std::nullopt;
    const auto value = ParseUint(bytes.substr(position, end - position));
    if (!value) return std::nullopt;
    number = *value;
    position = end + 1;
  }
  return ColmapHeader{numbers[0], numbers[1], numbers[2], position};
}

StoredDepth CopyFloats(PlaneSize size, std::string_view data, DepthFileFormat format) {
  StoredDepth depth;
  depth.width_px = size.width_px;
  depth.height_px = size.height_px;
  depth.values.resize(static_cast<size_t>(size.width_px) * static_cast<size_t>(size.height_px));
  std::memcpy(depth.values.data(), data.data(), depth.values.size() * sizeof(float));
  depth.format = format;
  depth.sample_type = "float32";
  return depth;
}

// Reads the numbers after the two letters of the format; comments run from # to the end of the
// line.
class NetpbmHeader {
 public:
  NetpbmHeader(const path& file, std::string_view bytes) : file_(file), bytes_(bytes) {}

  std::string_view NextToken(const char* field) {
    while (position_ < bytes_.size() && (IsSpace() || bytes_[position_] == '#')) {
      if (bytes_[position_] == '#') {
        position_ = std::min(bytes_.find('\n', position_), bytes_.size() - 1);
      }
      ++position_;
    }
    const size_t begin = position_;
    while (position_ < bytes_.size() && !IsSpace()) ++position_;
    if (position_ == bytes_.size()) throw InputError(file_, field, "the file ends here");
    return bytes_.substr(begin, position_ - begin);
  }

  uint64_t NextUint(const char* field) {
    const std::string_view token = NextToken(field);
    const auto value = ParseUint(token);
    if (!value) Fail(field, "a count", token);
    return *value;
  }

  double NextScale(const char* field) {
    const std::string_view token = NextToken(field);
    const auto value = ParseDouble(token);
    if (!value || !std::isfinite(*value) || *value == 0) {
      Fail(field, "a number other than 0", token);
    }
    return *value;
  }

  // One white space ends the header.
  std::string_view Data() const { return bytes_.substr(position_ + 1); }

 private:
  bool IsSpace() const { return std::isspace(static_cast<unsigned char>(bytes_[position_])) != 0; }
  [[noreturn]] void Fail(const char* field, std::string_view expected,
                         std::string_view found) const {
    throw InputError(file_, field,
                     fmt::format("expected {}, found \"{}\"", expected, found.substr(0, 20)));
  }

  const path& file_;
  std::string_view bytes_;
  size_t position_ = 2;
};

StoredDepth MakeStored(uint64_t width, uint64_t height, DepthFileFormat format,
                       const char* sample_type) {
  StoredDepth depth;
  depth.width_px = static_cast<int>(width);
  depth.height_px = static_cast<int>(height);
  depth.values.resize(width * height);
  depth.format = format;
  depth.sample_type = sample_type;
  return depth;
}

}  // namespace

bool IsColmapMap(std::string_view bytes) { return ParseColmapHeader(bytes).has_value(); }

StoredDepth DecodeColmapMap(const path& file, std::string_view bytes) {
  const ColmapHeader header = ParseColmapHeader(bytes).value();
  if (header.channels != 1) {
    throw InputError(file, fmt::format("expected a depth map of one channel, found {}{}",
                                       header.channels, header.channels == 3 ? " (normals)" : ""));
  }
  const std::string_view data = bytes.substr(header.data_offset);
  CheckClaimedSize(file, header.width, header.height, data.size() / sizeof(float));
  return CopyFloats({static_cast<int>(header.width), static_cast<int>(header.height)}, data,
                    DepthFileFormat::kColmap);
}

std::string EncodeColmapMap(const FloatPlane& plane) {
  std::string bytes = fmt::format("{}&{}&1&", plane.width_px, plane.height_px);
  bytes += AsBytes(plane.values);
  return bytes;
}

StoredDepth DecodeRaw(const path& file, std::string_view bytes, PlaneSize size) {
  RAYLIFT_CHECK(size.width_px > 0 && size.height_px > 0);
  const size_t expected =
      static_cast<size_t>(size.width_px) * static_cast<size_t>(size.height_px) * sizeof(float);
  if (bytes.size() != expected) {
    throw InputError(file, fmt::format("expected {} x {} floats without a header, {} bytes, found "
                                       "{} bytes",
                                       size.width_px, size.height_px, expected, bytes.size()));
  }
  return CopyFloats(size, bytes, DepthFileFormat::kRaw);
}

StoredDepth DecodePgm(const path& file, std::string& bytes) {
  NetpbmHeader header(file, bytes);
  const uint64_t width = header.NextUint("width");
  const uint64_t height = header.NextUint("height");
  const uint64_t max_value = header.NextUint("largest value");
  if (max_value == 0 || max_value > 65535) {
    throw InputError(file, "largest value",
                     fmt::format("expected 1 to 65535, found {}", max_value));
  }
  const std::string_view data = header.Data();
  const size_t sample_bytes = max_value > 255 ? 2 : 1;
  CheckClaimedSize(file, width, height, data.size() / sample_bytes);
  StoredDepth depth =
      MakeStored(width, height, DepthFileFormat::kPgm, sample_bytes == 2 ? "uint16" : "uint8");
  for (size_t i = 0; i < depth.values.size(); ++i) {
    const auto byte = [&data](size_t at) { return static_cast<unsigned char>(data[at]); };
    depth.values[i] =
        static_cast<float>(sample_bytes == 1 ? byte(i) : byte(2 * i) * 256 + byte(2 * i + 1));
  }
  return depth;
}

bool IsPfm(std::string_view bytes) {
  return bytes.size() > 2 && (bytes.starts_with("Pf") || bytes.starts_with("PF")) &&
         std::isspace(static_cast<unsigned char>(bytes[2])) != 0;
}

StoredDepth DecodePfm(const path& file, std::string_view bytes) {
  if (bytes[1] == 'F') {
    throw InputError(file, "expected a PFM of one channel (Pf), found three (PF)");
  }
  NetpbmHeader header(file, bytes);
  const uint64_t width = header.NextUint("width");
  const uint64_t height = header.NextUint("height");
  const double scale = header.NextScale("scale");
  const std::string_view data = header.Data();
  CheckClaimedSize(file, width, height, data.size() / sizeof(float));
  StoredDepth depth = MakeStored(width, height, DepthFileFormat::kPfm, "float32");
  depth.declared_scale = std::abs(scale);
  for (uint64_t y = 0; y < height; ++y) {
    const char* row = data.data() + (height - 1 - y) * width * sizeof(float);
    for (uint64_t x = 0; x < width; ++x) {
      depth.values[y * width + x] = LoadNumber<float>(row + x * sizeof(float), scale > 0);
    }
  }
  return depth;
}

std::string EncodePfm(const FloatPlane& plane) {
  std::string bytes = fmt::format("Pf\n{} {}\n-1\n", plane.width_px, plane.height_px);
  const auto width = static_cast<size_t>(plane.width_px);
  for (auto y = static_cast<size_t>(plane.height_px); y-- > 0;) {
    bytes += AsBytes(plane.values.subspan(y * width, width));
  }
  return bytes;
}

}  // namespace raylift
