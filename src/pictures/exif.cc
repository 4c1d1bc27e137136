#include "pictures/exif.h"

#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>

namespace raylift {
namespace {

// The segment's contents behind its name; empty where there is none before the pixels.
std::string ExifSegment(std::istream& file) {
  constexpr std::string_view kName("Exif\0\0", 6);
  constexpr int kStartOfScan = 0xDA, kApp1 = 0xE1;
  if (file.get() != 0xFF || file.get() != 0xD8) return {};
  while (file.get() == 0xFF) {
    int marker = file.get();
    while (marker == 0xFF) marker = file.get();  // fill
    const int length = file.get() << 8 | file.get();
    if (!file || marker == kStartOfScan || length < 2) return {};
    std::string segment(static_cast<size_t>(length) - 2, '\0');
    file.read(segment.data(), static_cast<std::streamsize>(segment.size()));
    if (marker == kApp1 && file && segment.starts_with(kName)) return segment.substr(kName.size());
  }
  return {};
}

// A TIFF file: a byte order, and directories of entries. What lies outside of it reads as nothing.
class Tiff {
 public:
  explicit Tiff(std::string_view bytes) : bytes_(bytes), is_big_endian_(bytes.starts_with("MM")) {}

  uint32_t Number(size_t at, size_t num_bytes) const {
    if (at > bytes_.size() || num_bytes > bytes_.size() - at) return 0;
    uint32_t value = 0;
    for (size_t i = 0; i < num_bytes; ++i) {
      value =
          value << 8 | static_cast<uint8_t>(bytes_[at + (is_big_endian_ ? i : num_bytes - 1 - i)]);
    }
    return value;
  }

  // Returns the first value of a tag in a directory; nullopt where it is not there, or not
  // positive.
  std::optional<double> Value(size_t directory, uint32_t tag) const {
    constexpr uint32_t kShort = 3, kLong = 4, kRational = 5;
    const uint32_t num_entries = Number(directory, 2);
    for (uint32_t i = 0; i < num_entries; ++i) {
      const size_t entry = directory + 2 + size_t{12} * i;
      if (Number(entry, 2) != tag) continue;
      const uint32_t type = Number(entry + 2, 2);
      double value = 0;
      if (type == kShort) value = Number(entry + 8, 2);
      if (type == kLong) value = Number(entry + 8, 4);
      if (type == kRational) {
        const size_t at = Number(entry + 8, 4);
        value = static_cast<double>(Number(at, 4)) / static_cast<double>(Number(at + 4, 4));
      }
      return value > 0 && std::isfinite(value) ? std::optional(value) : std::nullopt;
    }
    return std::nullopt;
  }

 private:
  std::string_view bytes_;
  bool is_big_endian_;
};

// Units of resolutions, as EXIF and some cameras have them.
double MmOfUnit(double unit) {
  if (unit == 3) return 10;
  if (unit == 4) return 1;
  return unit == 5 ? 1e-3 : 25.4;
}

}  // namespace

Exif ReadExif(std::istream& file) {
  constexpr uint32_t kOrientation = 0x0112, kCameraDirectory = 0x8769, kFocalLength = 0x920A,
                     kFocalLengthIn35mm = 0xA405, kPlaneXResolution = 0xA20E, kPlaneUnit = 0xA210;
  const std::string segment = ExifSegment(file);
  const Tiff tiff(segment);
  Exif exif;
  const size_t first = tiff.Number(4, 4);
  const double orientation = tiff.Value(first, kOrientation).value_or(1);
  if (orientation >= 1 && orientation <= 8) exif.orientation = static_cast<int>(orientation);
  const auto directory = tiff.Value(first, kCameraDirectory);
  if (!directory) return exif;
  const auto camera = static_cast<size_t>(*directory);
  exif.focal_mm = tiff.Value(camera, kFocalLength);
  exif.focal_35mm = tiff.Value(camera, kFocalLengthIn35mm);
  if (const auto per_unit = tiff.Value(camera, kPlaneXResolution)) {
    exif.pixels_per_mm = *per_unit / MmOfUnit(tiff.Value(camera, kPlaneUnit).value_or(2));
  }
  return exif;
}

}  // namespace raylift
