#include "io/image/cut_short.h"

#include <cstddef>
#include <cstdint>

namespace raylift {
namespace {

size_t BigEndian(std::string_view bytes) {
  size_t value = 0;
  for (const char c : bytes) value = (value << 8) | static_cast<uint8_t>(c);
  return value;
}

// Segments of a marker and a length each, up to the first scan; in scans 0xFF is followed by 0 or
// a marker, so that the end of the image is found by its own. (Thumbnails have ends, too: within a
// segment.)
bool JpegIsCutShort(std::string_view bytes) {
  constexpr char kStartOfScan = '\xDA';
  constexpr std::string_view kEnd = "\xFF\xD9";
  size_t at = 2;
  while (at + 4 <= bytes.size()) {
    if (bytes[at] != '\xFF') return false;  // no JPEG that is known here
    if (bytes[at + 1] == '\xFF') {          // fill
      ++at;
      continue;
    }
    if (bytes[at + 1] == kStartOfScan) return bytes.find(kEnd, at) == std::string_view::npos;
    at += 2 + BigEndian(bytes.substr(at + 2, 2));
  }
  return true;
}

// Chunks of a length, a name, data and a checksum each.
bool PngIsCutShort(std::string_view bytes) {
  for (size_t at = 8; at + 12 <= bytes.size();) {
    const size_t end = at + 12 + BigEndian(bytes.substr(at, 4));
    if (bytes.substr(at + 4, 4) == "IEND") return end > bytes.size();
    at = end;
  }
  return true;
}

}  // namespace

bool IsCutShort(std::string_view bytes) {
  if (bytes.substr(0, 2) == "\xFF\xD8") return JpegIsCutShort(bytes);
  if (bytes.substr(0, 4) == "\x89PNG") return PngIsCutShort(bytes);
  return false;
}

}  // namespace raylift
