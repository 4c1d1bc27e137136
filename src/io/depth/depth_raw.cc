// Depth maps as plain little-endian floats: COLMAP's with a line of sizes before them, kapture's
// and ETH3D's with nothing.

#include <array>
#include <cstring>

#include "io/depth/depth_formats.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

// "width&height&channels&" and nothing else before the data.
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
  bytes.append(reinterpret_cast<const char*>(plane.values.data()), plane.values.size_bytes());
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

}  // namespace raylift
