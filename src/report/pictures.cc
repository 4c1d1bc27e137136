#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "features/cv_image.h"
#include "pictures/picture_codec.h"
#include "report/page.h"
#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

using Color = std::array<double, 3>;  // red, green, blue, 0 to 255

constexpr Color kUnknown = {128, 128, 128};
// Nodes of a sequential map of rising brightness (after viridis).
constexpr std::array<Color, 6> kSequential = {
    {{68, 1, 84}, {65, 68, 135}, {42, 120, 142}, {34, 168, 132}, {122, 209, 81}, {253, 231, 37}}};
constexpr Color kTooNear = {0, 90, 181};
constexpr Color kRight = {247, 247, 247};
constexpr Color kTooFar = {220, 104, 0};
constexpr int kJpegQuality = 82;

Color Mix(const Color& a, const Color& b, double t) {
  return {a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])};
}

Color Sequential(double t) {
  const double place = std::clamp(t, 0.0, 1.0) * static_cast<double>(kSequential.size() - 1);
  const size_t i = std::min(static_cast<size_t>(place), kSequential.size() - 2);
  return Mix(kSequential[i], kSequential[i + 1], place - static_cast<double>(i));
}

std::string CssColor(const Color& color) {
  return fmt::format("rgb({},{},{})", color[0], color[1], color[2]);
}

template <typename Function>
Image Paint(const DepthMap& map, Function color_at) {
  Image image{map.width_px, map.height_px, 3, {}};
  image.data.reserve(3 * map.z.size());
  for (size_t i = 0; i < map.z.size(); ++i) {
    for (const double channel : color_at(i)) {
      image.data.push_back(static_cast<uint8_t>(std::lround(channel)));
    }
  }
  return image;
}

}  // namespace

std::optional<Image> ReadPhoto(const std::filesystem::path& folder, const std::string& name) {
  if (folder.empty()) return std::nullopt;
  try {
    return ReadImage(folder / name, ImageChannels::kRgb);
  } catch (const InputError&) {
    return std::nullopt;
  }
}

std::vector<std::string> DepthColors() {
  std::vector<std::string> colors;
  for (const Color& color : kSequential) colors.push_back(CssColor(color));
  return colors;
}

std::vector<std::string> ErrorColors() {
  return {CssColor(kTooNear), CssColor(kRight), CssColor(kTooFar)};
}

Image ColorizeDepth(const DepthMap& map, double near, double far) {
  const double log_near = std::log(near), log_range = std::log(std::max(far, near * 1.01) / near);
  return Paint(map, [&](size_t i) {
    if (!(map.z[i] > 0)) return kUnknown;
    return Sequential((std::log(static_cast<double>(map.z[i])) - log_near) / log_range);
  });
}

Image ColorizeError(const DepthMap& estimated, const DepthMap& truth, double full) {
  RAYLIFT_CHECK_EQ(estimated.z.size(), truth.z.size());
  return Paint(truth, [&](size_t i) {
    if (!(estimated.z[i] > 0) || !(truth.z[i] > 0)) return kUnknown;
    const double error = std::log(static_cast<double>(estimated.z[i] / truth.z[i])) / full;
    return Mix(kRight, error < 0 ? kTooNear : kTooFar, std::min(1.0, std::abs(error)));
  });
}

std::vector<int> ErrorHistogram(const DepthMap& estimated, const DepthMap& truth, double full,
                                int bins) {
  std::vector<int> histogram(static_cast<size_t>(bins), 0);
  for (size_t i = 0; i < truth.z.size(); ++i) {
    if (!(estimated.z[i] > 0) || !(truth.z[i] > 0)) continue;
    const double error = std::log(static_cast<double>(estimated.z[i] / truth.z[i])) / full;
    const double place = std::clamp((error + 1) / 2 * bins, 0.0, bins - 1.0);
    ++histogram[static_cast<size_t>(place)];
  }
  return histogram;
}

std::string JpegDataUri(const Image& image, int max_width_px) {
  Image small = image;
  if (image.width_px > max_width_px) {
    const int type = CV_8UC(image.channels);
    small.width_px = max_width_px;
    small.height_px = std::max(1, image.height_px * max_width_px / image.width_px);
    small.data.resize(static_cast<size_t>(small.width_px) * static_cast<size_t>(small.height_px) *
                      static_cast<size_t>(image.channels));
    cv::Mat target(small.height_px, small.width_px, type, small.data.data());
    cv::resize(AsMat(image), target, target.size(), 0, 0, cv::INTER_AREA);
  }
  return "data:image/jpeg;base64," + EncodeBase64(EncodeJpeg(small, kJpegQuality));
}

std::string PngDataUri(const Image& image) {
  return "data:image/png;base64," + EncodeBase64(EncodePng(image));
}

}  // namespace raylift
