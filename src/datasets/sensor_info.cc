#include "datasets/sensor_info.h"

#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "base/read_limits.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Lines "key = value".
class Info {
 public:
  explicit Info(const path& file) : file_(file) {
    LineReader lines(file);
    while (const auto line = lines.NextContent()) {
      const size_t equals = line->find('=');
      if (equals == std::string_view::npos) continue;
      values_[std::string(Trim(line->substr(0, equals)))] = Trim(line->substr(equals + 1));
    }
  }

  // The numbers of a value; at least `count`.
  std::vector<double> Numbers(const std::string& key, size_t count) const {
    const auto value = values_.find(key);
    if (value == values_.end()) throw InputError(file_, key, "the value is missing");
    std::vector<double> numbers;
    for (const std::string_view token : SplitTokens(value->second)) {
      const auto number = ParseDouble(token);
      if (!number || !std::isfinite(*number)) {
        throw InputError(file_, key, fmt::format("expected numbers, found \"{}\"", token));
      }
      numbers.push_back(*number);
    }
    if (numbers.size() < count) {
      throw InputError(file_, key,
                       fmt::format("expected {} numbers, found {}", count, numbers.size()));
    }
    return numbers;
  }

  int Side(const std::string& key) const {
    const double side = Numbers(key, 1)[0];
    if (!(side >= 1 && side <= kMaxImageSidePx))
      throw InputError(file_, key, "expected a size in pixels");
    return static_cast<int>(side);
  }

 private:
  path file_;
  std::map<std::string, std::string> values_;
};

}  // namespace

Camera ReadColorCamera(const path& file) {
  const Info info(file);
  const std::vector<double> k = info.Numbers("m_calibrationColorIntrinsic", 7);  // rows of four
  const int width_px = info.Side("m_colorWidth"), height_px = info.Side("m_colorHeight");
  try {
    return CameraOfSensor(width_px, height_px, k[0], k[5], k[2], k[6]);
  } catch (const InputError& error) {
    throw InputError(file, "m_calibrationColorIntrinsic", error.what());
  }
}

Camera CameraOfSensor(int width_px, int height_px, double fx, double fy, double cx, double cy) {
  return Camera(CameraModel::kPinhole, width_px, height_px,
                std::vector<double>{fx, fy, cx + 0.5, cy + 0.5});
}

}  // namespace raylift
