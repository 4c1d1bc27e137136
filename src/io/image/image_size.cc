// The size of a photograph without decoding it: for data sets of many thousand.

#include <fstream>

#include "pictures/picture_header.h"

#include "raylift/io/image_file.h"

namespace raylift {

PlaneSize ReadImageSize(const std::filesystem::path& path) {
  std::error_code ignored;
  if (std::filesystem::is_regular_file(path, ignored)) {
    std::ifstream file(path, std::ios::binary);
    if (const auto size = PictureSizeFromHeader(file)) return *size;
  }
  const Image image = ReadImage(path, ImageChannels::kGray);
  return {image.width_px, image.height_px};
}

}  // namespace raylift
