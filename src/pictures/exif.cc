#include "pictures/exif.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

namespace raylift {
namespace {

// The segments of a JPEG before its pixels; empty where there are none.
struct Segments {
  bool is_jpeg = false;
  std::string exif, xmp;
};

Segments ReadSegments(std::istream& file) {
  constexpr std::string_view kExif("Exif\0\0", 6), kXmp("http://ns.adobe.com/xap/1.0/\0", 29);
  constexpr int kStartOfScan = 0xDA, kApp1 = 0xE1;
  Segments segments;
  if (file.get() != 0xFF || file.get() != 0xD8) return {};
  segments.is_jpeg = true;
  while (file.get() == 0xFF) {
    int marker = file.get();
    while (marker == 0xFF) marker = file.get();  // fill
    const int length = file.get() << 8 | file.get();
    if (!file || marker == kStartOfScan || length < 2) break;
    std::string segment(static_cast<size_t>(length) - 2, '\0');
    file.read(segment.data(), static_cast<std::streamsize>(segment.size()));
    if (marker != kApp1 || !file) continue;
    for (const auto& [name, contents] :
         {std::pair(kExif, &segments.exif), std::pair(kXmp, &segments.xmp)}) {
      if (segment.starts_with(name) && contents->empty()) *contents = segment.substr(name.size());
    }
  }
  return segments;
}

// Reads a TIFF file: a byte order, and directories of entries. What lies outside of it reads as
// nothing.
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
    const auto values = Values<1>(directory, tag);
    return values && (*values)[0] > 0 ? std::optional((*values)[0]) : std::nullopt;
  }

  // Returns the first N values of a tag, which are finite; nullopt where it has fewer.
  template <size_t N>
  std::optional<std::array<double, N>> Values(size_t directory, uint32_t tag) const {
    constexpr uint32_t kByte = 1, kShort = 3, kLong = 4, kRational = 5;
    const auto entry = Entry(directory, tag);
    if (!entry || Number(*entry + 4, 4) < N) return std::nullopt;
    const uint32_t type = Number(*entry + 2, 2);
    std::array<double, N> values{};
    for (size_t i = 0; i < N; ++i) {
      double& value = values[i];
      if (type == kByte) value = Number(*entry + 8, 1);
      if (type == kShort) value = Number(*entry + 8, 2);
      if (type == kLong) value = Number(*entry + 8, 4);
      if (type == kRational) {
        const size_t at = Number(*entry + 8, 4) + 8 * i;
        const uint32_t numerator = Number(at, 4), denominator = Number(at + 4, 4);
        // Seconds are 0/0 where minutes are decimal.
        const bool is_left_out = i == 2 && numerator == 0 && denominator == 0;
        value = is_left_out ? 0 : static_cast<double>(numerator) / denominator;
      }
      if (!std::isfinite(value)) return std::nullopt;
    }
    return values;
  }

  // Returns the letter of a tag that is one; 0 where it is not there.
  char Letter(size_t directory, uint32_t tag) const {
    constexpr uint32_t kText = 2;
    const auto entry = Entry(directory, tag);
    return entry && Number(*entry + 2, 2) == kText ? bytes_[*entry + 8] : '\0';
  }

 private:
  // Returns the place of a tag's entry, which is in the file.
  std::optional<size_t> Entry(size_t directory, uint32_t tag) const {
    constexpr size_t kEntryBytes = 12;
    const uint32_t num_entries = Number(directory, 2);
    for (uint32_t i = 0; i < num_entries; ++i) {
      const size_t entry = directory + 2 + kEntryBytes * i;
      if (entry + kEntryBytes > bytes_.size()) return std::nullopt;
      if (Number(entry, 2) == tag) return entry;
    }
    return std::nullopt;
  }

  std::string_view bytes_;
  bool is_big_endian_;
};

// Returns the millimeters of a unit of resolutions, as EXIF and some cameras have them.
double MmOfUnit(double unit) {
  if (unit == 3) return 10;
  if (unit == 4) return 1;
  return unit == 5 ? 1e-3 : 25.4;
}

// Returns the degrees of a position's degrees, minutes and seconds with the letter of its side.
std::optional<double> Degrees(const Tiff& tiff, size_t directory, uint32_t tag, char negative) {
  const auto parts = tiff.Values<3>(directory, tag);
  if (!parts) return std::nullopt;
  const double degrees = (*parts)[0] + (*parts)[1] / 60 + (*parts)[2] / 3600;
  return tiff.Letter(directory, tag - 1) == negative ? -degrees : degrees;
}

std::optional<GpsTags> ReadGps(const Tiff& tiff, size_t directory) {
  constexpr uint32_t kLatitude = 2, kLongitude = 4, kAltitudeIs = 5, kAltitude = 6,
                     kDirectionIs = 0x10, kDirection = 0x11, kHorizontalError = 0x1F;
  const auto latitude = Degrees(tiff, directory, kLatitude, 'S');
  const auto longitude = Degrees(tiff, directory, kLongitude, 'W');
  if (!latitude || !longitude) return std::nullopt;
  GpsTags gps{.latitude_deg = *latitude, .longitude_deg = *longitude};
  // 1 and, since EXIF 3, 3 mean below. Devices do not say reliably what altitudes are above.
  const double altitude_is = tiff.Value(directory, kAltitudeIs).value_or(0);
  if (const auto altitude = tiff.Values<1>(directory, kAltitude)) {
    gps.altitude_m = altitude_is == 1 || altitude_is == 3 ? -(*altitude)[0] : (*altitude)[0];
  }
  gps.horizontal_error_m = tiff.Value(directory, kHorizontalError);
  if (const auto direction = tiff.Values<1>(directory, kDirection)) {
    gps.direction_deg = (*direction)[0];
    gps.direction_is_magnetic = tiff.Letter(directory, kDirectionIs) == 'M';
  }
  return gps;
}

}  // namespace

Exif ReadExif(std::istream& file) {
  constexpr uint32_t kOrientation = 0x0112, kCameraDirectory = 0x8769, kGpsDirectory = 0x8825,
                     kFocalLength = 0x920A, kFocalLengthIn35mm = 0xA405, kPixelWidth = 0xA002,
                     kPlaneXResolution = 0xA20E, kPlaneUnit = 0xA210;
  const Segments segments = ReadSegments(file);
  const Tiff tiff(segments.exif);
  Exif exif{.is_jpeg = segments.is_jpeg};
  if (!segments.xmp.empty()) exif.drone = ParseDroneTags(segments.xmp);
  if (exif.drone) exif.lens.calibration = exif.drone->calibration;
  const size_t first = tiff.Number(4, 4);
  const double orientation = tiff.Value(first, kOrientation).value_or(1);
  if (orientation >= 1 && orientation <= 8) exif.orientation = static_cast<int>(orientation);
  if (const auto gps = tiff.Value(first, kGpsDirectory)) {
    exif.gps = ReadGps(tiff, static_cast<size_t>(*gps));
  }
  const auto directory = tiff.Value(first, kCameraDirectory);
  if (!directory) return exif;
  const auto camera = static_cast<size_t>(*directory);
  exif.focal_mm = tiff.Value(camera, kFocalLength);
  exif.lens.film_mm = tiff.Value(camera, kFocalLengthIn35mm);
  exif.lens.taken_width_px = tiff.Value(camera, kPixelWidth);
  if (const auto per_unit = tiff.Value(camera, kPlaneXResolution)) {
    exif.pixels_per_mm = *per_unit / MmOfUnit(tiff.Value(camera, kPlaneUnit).value_or(2));
  }
  return exif;
}

}  // namespace raylift
