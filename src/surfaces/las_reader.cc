// Reads LAS, the laser scanners' format, versions 1.0 to 1.4, as the ASPRS specifies it:
// coordinates are integers, times a scale, plus an offset. Little-endian throughout.

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "base/bytes.h"
#include "surfaces/file_readers.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

static_assert(std::endian::native == std::endian::little, "the reader copies bytes as they are");

// Describes a point data record format: its least length, and where its color is, if it has one.
struct RecordFormat {
  size_t min_bytes;
  size_t color_at;  // 0: none
};
constexpr std::array<RecordFormat, 11> kFormats = {{{20, 0},
                                                    {28, 0},
                                                    {26, 20},
                                                    {34, 28},
                                                    {57, 0},
                                                    {63, 28},
                                                    {30, 0},
                                                    {36, 30},
                                                    {38, 30},
                                                    {59, 0},
                                                    {67, 30}}};
constexpr size_t kFirstExtended =
    6;  // from this format on, flags and classes have bytes of their own

// Points of these classes are on no surface.
constexpr int kLowNoise = 7;
constexpr int kHighNoise = 18;

class LasReader {
 public:
  LasReader(const std::filesystem::path& path, std::string_view bytes)
      : path_(path), bytes_(bytes) {}

  PointCloud Read() {
    ReadHeader();
    cloud_.points_in_world.reserve(count_);
    if (kFormats[format_].color_at > 0) colors_.reserve(count_);
    for (uint64_t i = 0; i < count_; ++i) ReadPoint(data_at_ + i * record_bytes_);
    if (left_out_ > 0) {
      cloud_.warnings.push_back(
          fmt::format("{}: {} of {} points left out: the file withholds them or calls them noise",
                      path_.string(), left_out_, count_));
    }
    TakeColors();
    return std::move(cloud_);
  }

 private:
  template <typename T>
  T At(size_t place) const {
    return LoadNumber<T>(bytes_.data() + place);
  }

  void ReadHeader() {
    constexpr size_t kHeaderBytes = 227;    // of versions 1.0 to 1.2
    constexpr size_t kHeaderBytes14 = 375;  // of version 1.4
    if (!bytes_.starts_with("LASF")) {
      throw InputError(path_, "expected a LAS file, whose first bytes are \"LASF\"");
    }
    const size_t minor = bytes_.size() > 25 ? At<uint8_t>(25) : 0;
    const bool is_14 = minor >= 4;
    if (bytes_.size() < (is_14 ? kHeaderBytes14 : kHeaderBytes)) {
      throw InputError(path_, "header", "the file ends early");
    }
    if (At<uint8_t>(24) != 1 || minor > 4) {
      throw InputError(path_, "header, version",
                       fmt::format("expected 1.0 to 1.4, found {}.{}", At<uint8_t>(24), minor));
    }
    const size_t format = At<uint8_t>(104);
    if (format >= 64) {  // the bits by which LAZ marks it
      throw InputError(path_, "header, point data format",
                       "compressed LAS is not read: expected it decompressed");
    }
    if (format >= kFormats.size()) {
      throw InputError(path_, "header, point data format",
                       fmt::format("expected 0 to {}, found {}", kFormats.size() - 1, format));
    }
    format_ = format;
    record_bytes_ = At<uint16_t>(105);
    if (record_bytes_ < kFormats[format_].min_bytes) {
      throw InputError(path_, "header, point data record length",
                       fmt::format("expected {} or more in format {}, found {}",
                                   kFormats[format_].min_bytes, format_, record_bytes_));
    }
    data_at_ = At<uint32_t>(96);
    count_ = At<uint32_t>(107);
    if (is_14 && count_ == 0) count_ = At<uint64_t>(247);
    const size_t room = data_at_ <= bytes_.size() ? (bytes_.size() - data_at_) / record_bytes_ : 0;
    if (count_ > room) {
      throw InputError(path_, "header, number of point records",
                       fmt::format("the header claims {}, the file has room for {}", count_, room));
    }
    for (size_t axis = 0; axis < 3; ++axis) {
      scale_[static_cast<Eigen::Index>(axis)] = Finite(131 + 8 * axis, "scale", axis);
      offset_[static_cast<Eigen::Index>(axis)] = Finite(155 + 8 * axis, "offset", axis);
    }
    if (!(scale_.array() != 0).all()) {
      throw InputError(path_, "header, scale factor", "expected a number other than 0");
    }
  }

  double Finite(size_t place, std::string_view field, size_t axis) const {
    const auto value = At<double>(place);
    if (!std::isfinite(value)) {
      throw InputError(path_, fmt::format("header, {} {}", "xyz"[axis], field),
                       fmt::format("expected a finite number, found {}", value));
    }
    return value;
  }

  bool IsLeftOut(size_t place) const {
    const auto low = At<uint8_t>(place + 15);
    const bool is_extended = format_ >= kFirstExtended;
    const bool is_withheld = is_extended ? (low & 4u) != 0 : (low & 128u) != 0;
    const int kind = is_extended ? At<uint8_t>(place + 16) : low & 31;
    return is_withheld || kind == kLowNoise || (is_extended && kind == kHighNoise);
  }

  void ReadPoint(size_t place) {
    if (IsLeftOut(place)) {
      ++left_out_;
      return;
    }
    const Eigen::Vector3d units(At<int32_t>(place), At<int32_t>(place + 4), At<int32_t>(place + 8));
    cloud_.points_in_world.emplace_back(units.cwiseProduct(scale_) + offset_);
    if (const size_t at = kFormats[format_].color_at; at > 0) {
      colors_.push_back(
          {At<uint16_t>(place + at), At<uint16_t>(place + at + 2), At<uint16_t>(place + at + 4)});
    }
  }

  // Gives the cloud the colors that were read. They have 16 bits, but many writers store 8; where
  // all are black there are none.
  void TakeColors() {
    uint16_t largest = 0;
    for (const auto& color : colors_) {
      largest = std::max({largest, color[0], color[1], color[2]});
    }
    if (largest == 0) return;
    const int shift = largest > std::numeric_limits<uint8_t>::max() ? 8 : 0;
    cloud_.colors_rgb.reserve(colors_.size());
    const auto byte = [shift](uint16_t value) { return static_cast<uint8_t>(value >> shift); };
    for (const auto& color : colors_) {
      cloud_.colors_rgb.push_back({byte(color[0]), byte(color[1]), byte(color[2])});
    }
  }

  const std::filesystem::path& path_;
  std::string_view bytes_;
  size_t format_ = 0;
  size_t record_bytes_ = 0;
  size_t data_at_ = 0;
  uint64_t count_ = 0;
  Eigen::Vector3d scale_;
  Eigen::Vector3d offset_;
  std::vector<std::array<uint16_t, 3>> colors_;
  size_t left_out_ = 0;
  PointCloud cloud_;
};

}  // namespace

PointCloud ReadLasCloud(const std::filesystem::path& path, std::string_view contents) {
  return LasReader(path, contents).Read();
}

}  // namespace raylift
