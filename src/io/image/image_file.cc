#include "raylift/io/image_file.h"

#include <cctype>
#include <string>

#include "io/image/cut_short.h"
#include "pictures/picture_codec.h"

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

std::string Extension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) {
    c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  if (extension != ".png" && extension != ".jpg" && extension != ".jpeg") {
    throw InputError(path, "images are written as .png, .jpg or .jpeg only");
  }
  return extension;
}

}  // namespace

Image ReadImage(const std::filesystem::path& path, ImageChannels channels) {
  const std::string bytes = ReadFile(path);
  if (bytes.empty()) throw InputError(path, "expected an image, found an empty file");
  if (IsCutShort(bytes)) throw InputError(path, "the image ends too soon: the file is truncated");
  try {
    return DecodePicture(bytes, channels);
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
