#include "io/map/map_codec.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <stdexcept>
#include <vector>

#include "base/bytes.h"
#include "base/read_limits.h"
#include "pictures/codecs.h"
#include <fmt/format.h>
#include <zlib.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using std::filesystem::path;

// ---- numbers one after the other ----

template <typename T>
void Put(std::string& bytes, const T& value) {
  bytes += AsBytes(std::span<const T, 1>(&value, 1));
}

class Reader {
 public:
  Reader(const path& file, const std::string& name, std::string_view bytes)
      : file_(file), name_(name), rest_(bytes) {}

  template <typename T>
  T Take() {
    return LoadNumber<T>(Take(sizeof(T)).data());
  }
  std::string_view Take(size_t count) {
    if (count > rest_.size()) Fail("the entry is truncated");
    const std::string_view taken = rest_.substr(0, count);
    rest_.remove_prefix(count);
    return taken;
  }
  template <typename T>
  std::vector<T> TakeMany(size_t count) {
    std::vector<T> values(count);
    const std::string_view bytes = Take(count * sizeof(T));
    std::copy(bytes.begin(), bytes.end(), reinterpret_cast<char*>(values.data()));
    return values;
  }
  std::string_view Rest() const { return rest_; }
  [[noreturn]] void Fail(std::string_view message) const {
    throw InputError(file_, name_, message);
  }

 private:
  const path& file_;
  const std::string& name_;
  std::string_view rest_;
};

// ---- depth ----

constexpr int kNumCodes = 65536;
constexpr double kLastCode = kNumCodes - 2;  // from the first one of a surface

bool IsSurface(float z) { return z > 0 && std::isfinite(z); }

struct LogRange {
  double least = 0;
  double largest = 0;

  uint16_t CodeOf(float z) const {
    if (!IsSurface(z)) return 0;
    if (!(largest > least)) return 1;
    const double share = (std::log(static_cast<double>(z)) - least) / (largest - least);
    return static_cast<uint16_t>(1 + std::lround(kLastCode * std::clamp(share, 0.0, 1.0)));
  }
  float DepthOf(int code) const {
    if (code == 0) return 0;
    return static_cast<float>(std::exp(least + (largest - least) * (code - 1) / kLastCode));
  }
};

LogRange RangeOf(std::span<const float> depths) {
  LogRange range{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (const float z : depths) {
    if (!IsSurface(z)) continue;
    range.least = std::min(range.least, std::log(static_cast<double>(z)));
    range.largest = std::max(range.largest, std::log(static_cast<double>(z)));
  }
  return range.least <= range.largest ? range : LogRange{};
}

// Returns the median of left, upper and left + upper - upper left, which predicts across edges.
int Predicted(std::span<const int> ranks, int width, size_t i) {
  const auto column = static_cast<int>(i % static_cast<size_t>(width));
  const bool has_upper = i >= static_cast<size_t>(width);
  const int left = column > 0 ? ranks[i - 1] : 0;
  const int upper = has_upper ? ranks[i - static_cast<size_t>(width)] : 0;
  const int corner = column > 0 && has_upper ? ranks[i - static_cast<size_t>(width) - 1] : 0;
  return std::clamp(left + upper - corner, std::min(left, upper), std::max(left, upper));
}

// Numbers differences modulo 2^16 by their size: 0, -1, 1, -2, ...
uint16_t Folded(int difference) {
  const auto wrapped = static_cast<int16_t>(difference);
  return static_cast<uint16_t>(wrapped >= 0 ? 2 * wrapped : -2 * wrapped - 1);
}
int Unfolded(uint16_t folded) { return folded % 2 == 0 ? folded / 2 : -(folded + 1) / 2; }

}  // namespace

std::string Deflated(std::string_view bytes) {
  uLongf size = compressBound(bytes.size());
  std::string deflated(size, '\0');
  const int result =
      compress2(reinterpret_cast<Bytef*>(deflated.data()), &size,
                reinterpret_cast<const Bytef*>(bytes.data()), bytes.size(), Z_BEST_COMPRESSION);
  RAYLIFT_CHECK_EQ(result, Z_OK);
  deflated.resize(size);
  return deflated;
}

std::string Inflated(const path& file, const std::string& name, std::string_view deflated,
                     size_t size) {
  if (size > kMaxDeflateRatio * (deflated.size() + 1)) {
    throw InputError(file, name,
                     fmt::format("claims {} bytes, more than its {} compressed bytes can become",
                                 size, deflated.size()));
  }
  std::string bytes(size, '\0');
  uLongf inflated = size;
  const int result = uncompress(reinterpret_cast<Bytef*>(bytes.data()), &inflated,
                                reinterpret_cast<const Bytef*>(deflated.data()), deflated.size());
  if (result != Z_OK || inflated != size) {
    throw InputError(file, name, "the entry is damaged");
  }
  return bytes;
}

std::string EncodeDepth(const DepthMap& map) {
  const LogRange range = RangeOf(map.z);
  std::vector<int> ranks(map.z.size());
  std::vector<uint8_t> has_code(kNumCodes / 8);
  const auto bit = [](int code) { return static_cast<uint8_t>(1 << (code % 8)); };
  for (size_t i = 0; i < ranks.size(); ++i) {
    ranks[i] = range.CodeOf(map.z[i]);
    has_code[static_cast<size_t>(ranks[i]) / 8] |= bit(ranks[i]);
  }
  std::vector<int> rank_of_code(kNumCodes);
  int num_ranks = 0;
  for (int code = 0; code < kNumCodes; ++code) {
    rank_of_code[static_cast<size_t>(code)] = num_ranks;
    if ((has_code[static_cast<size_t>(code) / 8] & bit(code)) != 0) ++num_ranks;
  }
  for (int& rank : ranks) rank = rank_of_code[static_cast<size_t>(rank)];

  Image residuals = BlankImage(map.width_px, map.height_px, 3);
  for (size_t i = 0; i < ranks.size(); ++i) {
    const uint16_t folded = Folded(ranks[i] - Predicted(ranks, map.width_px, i));
    residuals.data[3 * i] = static_cast<uint8_t>(folded >> 8);
    residuals.data[3 * i + 1] = static_cast<uint8_t>(folded & 255);
  }
  const std::string codes = Deflated(AsBytes(std::span<const uint8_t>(has_code)));
  std::string bytes;
  Put(bytes, static_cast<uint32_t>(map.width_px));
  Put(bytes, static_cast<uint32_t>(map.height_px));
  Put(bytes, range.least);
  Put(bytes, range.largest);
  Put(bytes, static_cast<uint32_t>(codes.size()));
  bytes += codes;
  const auto picture = EncodeWebp(residuals);
  if (!picture) {
    throw InputError(fmt::format("a depth map of {} x {} pixels is too large for a packed map",
                                 map.width_px, map.height_px));
  }
  return bytes + *picture;
}

DepthMap DecodeDepth(const path& file, const std::string& name, std::string_view bytes) {
  Reader reader(file, name, bytes);
  const uint64_t width = reader.Take<uint32_t>();
  const uint64_t height = reader.Take<uint32_t>();
  if (width == 0 || height == 0 || width > kMaxDepthMapPixels / height) {
    reader.Fail(fmt::format("claims {} x {} pixels", width, height));
  }
  LogRange range;
  range.least = reader.Take<double>();
  range.largest = reader.Take<double>();
  if (!(range.least <= range.largest) || !std::isfinite(range.largest - range.least)) {
    reader.Fail("its range of depths is damaged");
  }
  const std::string_view deflated = reader.Take(reader.Take<uint32_t>());
  const std::string has_code = Inflated(file, name, deflated, kNumCodes / 8);
  std::vector<float> depths;  // by rank
  for (int code = 0; code < kNumCodes; ++code) {
    const auto eight = static_cast<uint8_t>(has_code[static_cast<size_t>(code) / 8]);
    if ((eight >> (code % 8) & 1) != 0) depths.push_back(range.DepthOf(code));
  }
  Image residuals;
  try {
    residuals =
        DecodeWebp(reader.Rest(), PlaneSize{static_cast<int>(width), static_cast<int>(height)});
  } catch (const std::runtime_error& error) {
    reader.Fail(error.what());
  }
  DepthMap map{residuals.width_px, residuals.height_px, {}};
  map.z.resize(width * height);
  std::vector<int> ranks(map.z.size());
  for (size_t i = 0; i < ranks.size(); ++i) {
    const auto folded =
        static_cast<uint16_t>(residuals.data[3 * i] << 8 | residuals.data[3 * i + 1]);
    ranks[i] = static_cast<uint16_t>(Predicted(ranks, map.width_px, i) + Unfolded(folded));
    if (static_cast<size_t>(ranks[i]) >= depths.size()) reader.Fail("the entry is damaged");
    map.z[i] = depths[static_cast<size_t>(ranks[i])];
  }
  return map;
}

// ---- features ----

namespace {

constexpr double kPixelShift = 0.5;  // from hloc's pixels to ours
constexpr int kCompactLevels = 8;

enum class Coding : uint8_t { kFloat, kHalf, kLevels };

// value = least + step * level
struct Levels {
  float least = 0;
  float step = 1;
  int count = 256;

  uint8_t LevelOf(float value) const {
    return static_cast<uint8_t>(
        std::lround(std::clamp((value - least) / step, 0.0f, static_cast<float>(count - 1))));
  }
  float ValueOf(uint8_t level) const { return least + step * static_cast<float>(level); }
};

// Returns the eight bits of COLMAP's databases where values fit, which are steps of a 512th; else
// steps from the least to the largest value.
Levels BytesFor(const Eigen::MatrixXf& values) {
  constexpr float kColmapStep = 1.0f / 512;
  const float least = values.minCoeff(), largest = values.maxCoeff();
  if (least >= 0 && largest <= 255 * kColmapStep) return {0, kColmapStep, 256};
  return {least, std::max((largest - least) / 255, std::numeric_limits<float>::min()), 256};
}

// Returns uniform levels with the least squared error (Max 1960): large values are rare and are cut
// off.
Levels CompactFor(const Eigen::MatrixXf& values) {
  constexpr int kTrials = 16;
  const float reach = std::max(values.cwiseAbs().maxCoeff(), std::numeric_limits<float>::min());
  const bool is_signed = values.minCoeff() < 0;
  Levels best;
  double least_error = std::numeric_limits<double>::infinity();
  for (int trial = 1; trial <= kTrials; ++trial) {
    const float end = reach * static_cast<float>(trial) / kTrials;
    const float begin = is_signed ? -end : 0;
    const Levels levels{begin, (end - begin) / (kCompactLevels - 1), kCompactLevels};
    double error = 0;
    for (const float value : values.reshaped()) {
      const double off = levels.ValueOf(levels.LevelOf(value)) - value;
      error += off * off;
    }
    if (error < least_error) {
      least_error = error;
      best = levels;
    }
  }
  return best;
}

Coding CodingFor(const Eigen::MatrixXf& descriptors, DescriptorPrecision precision) {
  if (precision != DescriptorPrecision::kExact) return Coding::kLevels;
  const bool fit = descriptors.cast<Eigen::half>().cast<float>() == descriptors;
  return fit ? Coding::kHalf : Coding::kFloat;
}

// Returns the step in which pixels are counted; 0 where they are floats.
double PixelStep(int width_px, int height_px, bool is_compact) {
  return is_compact ? std::max({width_px, height_px, 1}) / 65535.0 : 0;
}

}  // namespace

std::string EncodeFeatures(const Features& features, DescriptorPrecision precision) {
  const Eigen::MatrixXf& descriptors = features.descriptors;
  const size_t count = features.keypoints_px.size();
  // Without the image's size there are no steps to count in.
  const bool is_compact = precision == DescriptorPrecision::kCompact && features.image_width_px > 0;
  const bool has_scores = !is_compact && features.scores.size() == count;
  const Coding coding = CodingFor(descriptors, precision);
  Levels levels;
  if (coding == Coding::kLevels && descriptors.size() > 0) {
    levels = precision == DescriptorPrecision::kCompact ? CompactFor(descriptors)
                                                        : BytesFor(descriptors);
  }

  std::string head;
  Put(head, static_cast<uint32_t>(count));
  Put(head, static_cast<uint32_t>(descriptors.rows()));
  Put(head, static_cast<uint32_t>(features.image_width_px));
  Put(head, static_cast<uint32_t>(features.image_height_px));
  Put(head, features.uncertainty_px);
  Put(head, static_cast<uint8_t>(is_compact));
  Put(head, static_cast<uint8_t>(has_scores));
  Put(head, coding);
  Put(head, levels.least);
  Put(head, levels.step);

  std::string body;
  const double step = PixelStep(features.image_width_px, features.image_height_px, is_compact);
  for (int axis = 0; axis < 2; ++axis) {
    for (const Eigen::Vector2d& pixel : features.keypoints_px) {
      if (is_compact) {
        Put(body, static_cast<uint16_t>(std::lround(std::clamp(pixel[axis] / step, 0.0, 65535.0))));
      } else {
        Put(body, static_cast<float>(pixel[axis] - kPixelShift));
      }
    }
  }
  if (has_scores) body += AsBytes(std::span<const float>(features.scores));
  for (const float value : descriptors.reshaped()) {
    if (coding == Coding::kLevels) {
      Put(body, levels.LevelOf(value));
    } else if (coding == Coding::kHalf) {
      Put(body, Eigen::half(value).x);
    } else {
      Put(body, value);
    }
  }
  return head + Deflated(body);
}

Features DecodeFeatures(const path& file, const std::string& name, std::string_view bytes) {
  Reader head(file, name, bytes);
  const size_t count = head.Take<uint32_t>();
  const size_t dimension = head.Take<uint32_t>();
  Features features;
  const auto width = head.Take<uint32_t>(), height = head.Take<uint32_t>();
  features.uncertainty_px = head.Take<float>();
  const bool is_compact = head.Take<uint8_t>() != 0;
  const bool has_scores = head.Take<uint8_t>() != 0;
  const auto coding = head.Take<Coding>();
  Levels levels;
  levels.least = head.Take<float>();
  levels.step = head.Take<float>();
  if (coding > Coding::kLevels || std::max(width, height) > kMaxImageSidePx ||
      !std::isfinite(features.uncertainty_px) || !std::isfinite(levels.least + 255 * levels.step) ||
      dimension > kMaxPcdFieldValues) {
    head.Fail("its header is damaged");
  }
  features.image_width_px = static_cast<int>(width);
  features.image_height_px = static_cast<int>(height);

  const size_t of_value = coding == Coding::kLevels ? 1 : coding == Coding::kHalf ? 2 : 4;
  const size_t of_keypoint =
      2 * (is_compact ? sizeof(uint16_t) : sizeof(float)) + (has_scores ? sizeof(float) : 0);
  const std::string body_bytes =
      Inflated(file, name, head.Rest(), count * (of_keypoint + dimension * of_value));
  Reader body(file, name, body_bytes);
  const double step = PixelStep(features.image_width_px, features.image_height_px, is_compact);
  features.keypoints_px.resize(count);
  for (int axis = 0; axis < 2; ++axis) {
    for (Eigen::Vector2d& pixel : features.keypoints_px) {
      pixel[axis] = is_compact ? step * body.Take<uint16_t>()
                               : static_cast<double>(body.Take<float>()) + kPixelShift;
    }
  }
  for (const Eigen::Vector2d& pixel : features.keypoints_px) {
    if (!pixel.allFinite()) head.Fail("a keypoint is not finite");
  }
  if (has_scores) features.scores = body.TakeMany<float>(count);
  features.descriptors.resize(static_cast<Eigen::Index>(dimension),
                              static_cast<Eigen::Index>(count));
  for (float& value : features.descriptors.reshaped()) {
    if (coding == Coding::kLevels) {
      value = levels.ValueOf(body.Take<uint8_t>());
    } else if (coding == Coding::kHalf) {
      value = static_cast<float>(Eigen::numext::bit_cast<Eigen::half>(body.Take<uint16_t>()));
    } else {
      value = body.Take<float>();
    }
  }
  if (!features.descriptors.allFinite()) head.Fail("a descriptor is not finite");
  return features;
}

}  // namespace raylift
