#include "raylift/io/image_file.h"

#include <cctype>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <string>

#include "base/input_paths.h"
#include "pictures/exif.h"
#include "pictures/picture_codec.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

size_t BigEndian(std::string_view bytes) {
  size_t value = 0;
  for (const char c : bytes) value = (value << 8) | static_cast<uint8_t>(c);
  return value;
}

// Returns whether a JPEG is truncated. It consists of segments of a marker and a length each, up to
// the first scan; in scans 0xFF is followed by 0 or a marker, so that the end of the image is
// found. (Thumbnails have ends, too: within a segment.)
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

// Returns whether a PNG is truncated. It consists of chunks of a length, a name, data and a
// checksum each.
bool PngIsCutShort(std::string_view bytes) {
  for (size_t at = 8; at + 12 <= bytes.size();) {
    const size_t end = at + 12 + BigEndian(bytes.substr(at, 4));
    if (bytes.substr(at + 4, 4) == "IEND") return end > bytes.size();
    at = end;
  }
  return true;
}

// Returns whether a file is truncated: decoders silently fill the rest of the image with gray.
bool IsCutShort(std::string_view bytes) {
  if (bytes.substr(0, 2) == "\xFF\xD8") return JpegIsCutShort(bytes);
  if (bytes.substr(0, 4) == "\x89PNG") return PngIsCutShort(bytes);
  return false;
}

std::string Extension(const std::filesystem::path& path) {
  std::string extension = LowerExtension(path);
  if (extension != ".png" && extension != ".jpg" && extension != ".jpeg") {
    throw InputError(path, "images are written as .png, .jpg or .jpeg only");
  }
  return extension;
}

}  // namespace

PlaneSize ReadImageSize(const std::filesystem::path& path) {
  if (IsFile(path)) {
    std::ifstream file(path, std::ios::binary);
    if (const auto size = PictureSizeFromHeader(file)) return *size;
  }
  const Image image = ReadImage(path, ImageChannels::kGray);
  return {image.width_px, image.height_px};
}

LensTags ReadLensTags(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return ReadExif(file).lens;
}

std::optional<std::string> WhyOtherSize(const Camera& camera, const std::string& name,
                                        PlaneSize size, bool is_turned) {
  if (size == PlaneSize{camera.width_px(), camera.height_px()}) return std::nullopt;
  std::string message = fmt::format("the image is {} x {}, its camera {} x {}", size.width_px,
                                    size.height_px, camera.width_px(), camera.height_px());
  // Rounded sides change the ratio by so much.
  const double rounding = 1.0 / size.width_px + 1.0 / size.height_px;
  const double ratio_x = static_cast<double>(size.width_px) / camera.width_px();
  const double ratio_y = static_cast<double>(size.height_px) / camera.height_px();
  if (size == PlaneSize{camera.height_px(), camera.width_px()}) {
    message +=
        is_turned
            ? ": EXIF turns it in viewers; expected the camera of its pixels as they are stored"
            : ": turn the image, or take a camera of it as it stands";
  } else if (std::abs(ratio_x / ratio_y - 1) < rounding) {
    message += fmt::format("; scaled to the image it is: {} {}", name,
                           camera.Scaled(size.width_px, size.height_px).ToString());
  }
  return message;
}

void RequireSizeOf(const Camera& camera, const std::string& name, PlaneSize size,
                   const std::filesystem::path& file) {
  if (!WhyOtherSize(camera, name, size, false)) return;
  std::ifstream stream(file, std::ios::binary);
  throw InputError(file, *WhyOtherSize(camera, name, size, ReadExif(stream).SwapsSides()));
}

Image DecodePhotograph(std::string_view bytes, ImageChannels channels) {
  if (bytes.empty()) throw InputError("expected an image, found an empty file");
  if (IsCutShort(bytes)) throw InputError("the image ends too soon: the file is truncated");
  return DecodePicture(bytes, channels);
}

Image ReadImage(const std::filesystem::path& path, ImageChannels channels) {
  const std::string bytes = ReadFile(path);
  try {
    return DecodePhotograph(bytes, channels);
  } catch (const InputError& error) {
    throw InputError(path, error.what());
  }
}

void WriteImage(const std::filesystem::path& path, const Image& image, int jpeg_quality) {
  const std::string extension = Extension(path);
  RAYLIFT_CHECK(image.width_px > 0 && image.height_px > 0);
  RAYLIFT_CHECK(image.channels == 1 || image.channels == 3);
  RAYLIFT_CHECK_EQ(image.data.size(), static_cast<size_t>(image.width_px) * image.height_px *
                                          static_cast<size_t>(image.channels));
  std::string bytes;
  try {
    bytes = extension == ".png" ? EncodePng(image) : EncodeJpeg(image, jpeg_quality);
  } catch (const InputError& error) {
    throw InputError(path, error.what());
  }
  WriteFile(path, bytes);
}

}  // namespace raylift
