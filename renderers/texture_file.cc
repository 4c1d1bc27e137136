#include "texture_file.h"

#include <algorithm>
#include <limits>

#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/scene/picture_header.h"

namespace raylift {

std::optional<Image> DecodeTexture(std::span<const uint8_t> bytes) {
  if (bytes.empty() || bytes.size() > static_cast<size_t>(std::numeric_limits<int>::max())) {
    return std::nullopt;
  }
  if (WhyNoPicture({reinterpret_cast<const char*>(bytes.data()), bytes.size()})) {
    return std::nullopt;
  }
  try {
    const std::vector<uint8_t> buffer(bytes.begin(), bytes.end());
    const cv::Mat bgr = cv::imdecode(buffer, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
    if (bgr.empty()) {
      return std::nullopt;
    }
    Image image{bgr.cols, bgr.rows, 3, {}};
    image.data.resize(static_cast<size_t>(bgr.cols) * static_cast<size_t>(bgr.rows) * 3);
    cv::Mat rgb(bgr.rows, bgr.cols, CV_8UC3, image.data.data());
    cv::cvtColor(bgr, rgb, cv::COLOR_BGR2RGB);
    return image;
  } catch (const cv::Exception&) {
    return std::nullopt;
  }
}

int32_t AddTextureFile(const std::filesystem::path& mesh_path, const std::string& name,
                       RawMesh& mesh) {
  std::string portable = name;
  std::replace(portable.begin(), portable.end(), '\\', '/');
  const std::filesystem::path path = mesh_path.parent_path() / portable;
  try {
    const std::string bytes = ReadFile(path);
    auto image = DecodeTexture({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()});
    if (image) {
      mesh.textures.push_back(std::move(*image));
      return static_cast<int32_t>(mesh.textures.size()) - 1;
    }
    mesh.warnings.push_back(fmt::format("{}: texture {}: cannot be decoded as a picture",
                                        mesh_path.string(), path.string()));
  } catch (const InputError& error) {
    mesh.warnings.push_back(fmt::format("{}: texture {}", mesh_path.string(), error.what()));
  }
  return -1;
}

}  // namespace raylift
