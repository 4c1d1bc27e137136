// The size of a photograph without decoding it: for data sets of many thousand.

#include <array>
#include <cstdint>
#include <fstream>
#include <optional>
#include <span>

#include "raylift/io/image_file.h"

namespace raylift {
namespace {

constexpr int kMaxSide = 1 << 20;

uint32_t BigEndian(std::span<const uint8_t> bytes) {
  uint32_t value = 0;
  for (const uint8_t byte : bytes) value = (value << 8) | byte;
  return value;
}

template <size_t N>
std::optional<std::array<uint8_t, N>> Take(std::ifstream& file) {
  std::array<char, N> chars{};
  if (!file.read(chars.data(), N)) return std::nullopt;
  std::array<uint8_t, N> bytes{};
  for (size_t i = 0; i < N; ++i) bytes[i] = static_cast<uint8_t>(chars[i]);
  return bytes;
}

std::optional<PlaneSize> Checked(uint32_t width, uint32_t height) {
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide) return std::nullopt;
  return PlaneSize{static_cast<int>(width), static_cast<int>(height)};
}

// After the signature: the length and name of the header chunk, then width and height.
std::optional<PlaneSize> PngSize(std::ifstream& file) {
  const auto header = Take<16>(file);
  if (!header || BigEndian(std::span(*header).subspan(4, 4)) != 0x49484452) return std::nullopt;
  return Checked(BigEndian(std::span(*header).subspan(8, 4)),
                 BigEndian(std::span(*header).subspan(12, 4)));
}

// Start of frame: the markers C0 to CF but for DHT, JPG and DAC.
bool IsStartOfFrame(uint8_t marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

// After the first marker: segments of a marker and a length each.
std::optional<PlaneSize> JpegSize(std::ifstream& file) {
  while (const auto start = Take<4>(file)) {
    const uint8_t marker = (*start)[1];
    const uint32_t length = BigEndian(std::span(*start).subspan(2, 2));
    if ((*start)[0] != 0xFF || marker == 0xFF || length < 2) return std::nullopt;
    if (IsStartOfFrame(marker)) {
      const auto frame = Take<5>(file);  // the precision, height and width
      if (!frame) return std::nullopt;
      return Checked(BigEndian(std::span(*frame).subspan(3, 2)),
                     BigEndian(std::span(*frame).subspan(1, 2)));
    }
    file.seekg(length - 2, std::ios::cur);
  }
  return std::nullopt;
}

std::optional<PlaneSize> SizeFromHeader(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  const auto signature = Take<2>(file);
  if (!signature) return std::nullopt;
  if (*signature == std::array<uint8_t, 2>{0xFF, 0xD8}) return JpegSize(file);
  if (*signature == std::array<uint8_t, 2>{0x89, 0x50} && Take<6>(file)) return PngSize(file);
  return std::nullopt;
}

}  // namespace

PlaneSize ReadImageSize(const std::filesystem::path& path) {
  if (std::filesystem::is_regular_file(path)) {
    if (const auto size = SizeFromHeader(path)) return *size;
  }
  const Image image = ReadImage(path, ImageChannels::kGrey);
  return {image.width_px, image.height_px};
}

}  // namespace raylift
