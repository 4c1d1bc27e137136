#include "raylift/io/image_file.h"

#include <algorithm>
#include <string>
#include <vector>

#include "io/image/cut_short.h"
#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/scene/picture_header.h"

namespace raylift {
namespace {

// OpenCV's colours are blue, green, red; grey stays as it is. 16-bit files become 8-bit ones.
cv::Mat Decode(const std::filesystem::path& path, ImageChannels channels) {
  std::string bytes = ReadFile(path);
  if (bytes.empty()) {
    throw InputError(path, "expected an image, found an empty file");
  }
  if (IsCutShort(bytes)) throw InputError(path, "the image ends too soon: the file is truncated");
  if (const auto why = WhyNoPicture(bytes)) throw InputError(path, *why);
  const int flags = (channels == ImageChannels::kGrey ? cv::IMREAD_GRAYSCALE : cv::IMREAD_COLOR) |
                    cv::IMREAD_IGNORE_ORIENTATION;
  cv::Mat decoded;
  try {
    decoded = cv::imdecode(cv::Mat(1, static_cast<int>(bytes.size()), CV_8U, bytes.data()), flags);
  } catch (const cv::Exception& error) {
    throw InputError(path, fmt::format("the image cannot be decoded: {}", error.err));
  }
  if (decoded.empty()) {
    throw InputError(path, "expected an image, found something that cannot be decoded");
  }
  return decoded;
}

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
  const cv::Mat decoded = Decode(path, channels);
  Image image;
  image.width_px = decoded.cols;
  image.height_px = decoded.rows;
  image.channels = decoded.channels();
  image.data.resize(decoded.total() * decoded.elemSize());
  cv::Mat target(decoded.rows, decoded.cols, decoded.type(), image.data.data());
  if (channels == ImageChannels::kRgb) {
    cv::cvtColor(decoded, target, cv::COLOR_BGR2RGB);
  } else {
    decoded.copyTo(target);
  }
  return image;
}

void WriteImage(const std::filesystem::path& path, const Image& image, int jpeg_quality) {
  const std::string extension = Extension(path);
  RAYLIFT_CHECK(image.width_px > 0 && image.height_px > 0);
  RAYLIFT_CHECK(image.channels == 1 || image.channels == 3);
  RAYLIFT_CHECK_EQ(image.data.size(), static_cast<size_t>(image.width_px) * image.height_px *
                                          static_cast<size_t>(image.channels));
  cv::Mat pixels(image.height_px, image.width_px, CV_8UC(image.channels));
  std::copy(image.data.begin(), image.data.end(), pixels.data);
  if (image.channels == 3) {
    cv::cvtColor(pixels, pixels, cv::COLOR_RGB2BGR);
  }
  std::vector<int> options;
  if (extension != ".png") {
    options = {cv::IMWRITE_JPEG_QUALITY, jpeg_quality};
  }
  std::vector<uint8_t> bytes;
  try {
    cv::imencode(extension, pixels, bytes, options);
  } catch (const cv::Exception& error) {
    throw InputError(path, fmt::format("the image cannot be encoded: {}", error.err));
  }
  WriteFile(path, std::string(bytes.begin(), bytes.end()));
}

}  // namespace raylift
