// Reads PCD, the Point Cloud Library's format, as text or plain binary: a header of lines "KEY
// VALUE...", then points with the header's fields one after the other.

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <map>
#include <optional>

#include "base/bytes.h"
#include "base/read_limits.h"
#include "surfaces/file_readers.h"
#include "surfaces/input_files.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

static_assert(std::endian::native == std::endian::little, "the reader copies bytes as they are");

struct PcdField {
  std::string name;
  char type = 'F';  // F, I or U
  size_t bytes = 4;
  size_t count = 1;
  size_t at = 0;     // in a binary point
  size_t token = 0;  // in a line of text
};

// Reads the rest of the file, line by line.
class PcdLines {
 public:
  explicit PcdLines(std::string_view contents) : rest_(contents) {}

  std::string_view Next() {
    const size_t end = std::min(rest_.find('\n'), rest_.size());
    const std::string_view line = Trim(rest_.substr(0, end));
    rest_.remove_prefix(std::min(end + 1, rest_.size()));
    ++line_number_;
    return line;
  }

  std::string_view rest() const { return rest_; }
  int number() const { return line_number_; }

 private:
  std::string_view rest_;
  int line_number_ = 0;
};

struct PcdHeader {
  bool is_binary = false;
  uint64_t count = 0;
  std::vector<PcdField> fields;
  size_t point_bytes = 0;
  size_t point_tokens = 0;
};

class HeaderReader {
 public:
  HeaderReader(const std::filesystem::path& path, PcdLines& lines) : path_(path), lines_(lines) {}

  PcdHeader Read() {
    std::map<std::string, std::vector<std::string_view>, std::less<>> keys;
    while (!keys.contains("DATA")) {
      if (lines_.rest().empty())
        throw InputError(path_, "header", "the file ends before the line DATA");
      const std::string_view line = lines_.Next();
      if (line.empty() || line.starts_with('#')) continue;
      auto tokens = SplitTokens(line);
      const std::string key(tokens.front());
      tokens.erase(tokens.begin());
      if (!IsKey(key)) {
        throw InputError(path_, fmt::format("line {}", lines_.number()),
                         "expected a PCD header: VERSION, FIELDS, SIZE, TYPE, ... DATA");
      }
      keys[key] = std::move(tokens);
    }
    SetFields(keys);
    const auto& data = keys["DATA"];
    const std::string_view form = data.size() == 1 ? data[0] : "";
    if (form != "ascii" && form != "binary") {
      throw InputError(path_, "DATA",
                       fmt::format("expected ascii or binary, found \"{}\"", Shown(form)));
    }
    header_.is_binary = form == "binary";
    header_.count = CountOfPoints(keys);
    return std::move(header_);
  }

 private:
  static bool IsKey(std::string_view word) {
    for (const std::string_view key : {"VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH",
                                       "HEIGHT", "VIEWPOINT", "POINTS", "DATA"}) {
      if (key == word) return true;
    }
    return false;
  }

  template <typename Keys>
  void SetFields(Keys& keys) {
    const auto& names = keys["FIELDS"];
    if (names.empty()) throw InputError(path_, "FIELDS", "expected names, found none");
    const auto& sizes = keys["SIZE"];
    const auto& types = keys["TYPE"];
    const auto& counts = keys["COUNT"];
    for (size_t i = 0; i < names.size(); ++i) {
      PcdField field{.name = std::string(names[i])};
      const auto bytes = i < sizes.size() ? ParseUint(sizes[i]) : std::nullopt;
      if (!bytes || (*bytes != 1 && *bytes != 2 && *bytes != 4 && *bytes != 8)) {
        throw InputError(path_, "SIZE, " + Shown(names[i]), "expected 1, 2, 4 or 8");
      }
      if (i >= types.size() || (types[i] != "F" && types[i] != "I" && types[i] != "U") ||
          (types[i] == "F" && *bytes < 4)) {
        throw InputError(path_, "TYPE, " + Shown(names[i]), "expected I, U, or F of 4 or 8 bytes");
      }
      const auto count = counts.empty()      ? std::optional<uint64_t>(1)
                         : i < counts.size() ? ParseUint(counts[i])
                                             : std::nullopt;
      if (!count || *count > kMaxPcdFieldValues) {
        throw InputError(path_, "COUNT, " + Shown(names[i]),
                         fmt::format("expected a number up to {}", kMaxPcdFieldValues));
      }
      field.type = types[i].front();
      field.bytes = *bytes;
      field.count = *count;
      field.at = header_.point_bytes;
      field.token = header_.point_tokens;
      header_.point_bytes += field.bytes * field.count;
      header_.point_tokens += field.count;
      header_.fields.push_back(std::move(field));
    }
  }

  template <typename Keys>
  uint64_t CountOfPoints(Keys& keys) const {
    const auto number = [&](const std::string& key) -> std::optional<uint64_t> {
      const auto& tokens = keys[key];
      return tokens.size() == 1 ? ParseUint(tokens[0]) : std::nullopt;
    };
    auto count = number("POINTS");
    if (!count && keys["POINTS"].empty()) {
      const auto width = number("WIDTH");
      const auto height = number("HEIGHT");
      constexpr uint64_t kMostInRow = uint64_t{1} << 31;
      if (width && height && *width < kMostInRow && *height < kMostInRow) count = *width * *height;
    }
    if (!count) throw InputError(path_, "POINTS", "expected the number of points");
    // The last number of a text needs no separator.
    const uint64_t bytes = header_.is_binary ? lines_.rest().size() : lines_.rest().size() + 1;
    const uint64_t min_bytes = header_.is_binary ? header_.point_bytes : 2 * header_.point_tokens;
    const uint64_t room = min_bytes == 0 ? 0 : bytes / min_bytes;
    if (*count > room) {
      throw InputError(path_, "POINTS",
                       fmt::format("the header claims {}, the file has room for {}", *count, room));
    }
    return *count;
  }

  const std::filesystem::path& path_;
  PcdLines& lines_;
  PcdHeader header_;
};

class PcdReader {
 public:
  PcdReader(const std::filesystem::path& path, std::string_view contents)
      : path_(path), lines_(contents), header_(HeaderReader(path, lines_).Read()) {}

  PointCloud Read() {
    position_ = {Find({"x"}), Find({"y"}), Find({"z"})};
    if (std::find(position_.begin(), position_.end(), nullptr) != position_.end()) {
      throw InputError(path_, "FIELDS", "expected x, y and z among them");
    }
    normal_ = {Find({"normal_x", "nx"}), Find({"normal_y", "ny"}), Find({"normal_z", "nz"})};
    color_ = Find({"rgb", "rgba"});
    if (color_ != nullptr && color_->bytes != 4) {
      throw InputError(path_, "SIZE, " + color_->name,
                       fmt::format("expected 4, found {}", color_->bytes));
    }
    cloud_.points_in_world.reserve(header_.count);
    if (header_.is_binary) {
      ReadBinary();
    } else {
      ReadText();
    }
    return std::move(cloud_);
  }

 private:
  const PcdField* Find(std::initializer_list<std::string_view> names) const {
    for (const PcdField& field : header_.fields) {
      for (const std::string_view name : names) {
        if (field.name == name && field.count == 1) return &field;
      }
    }
    return nullptr;
  }

  bool has_normals() const {
    return std::find(normal_.begin(), normal_.end(), nullptr) == normal_.end();
  }

  template <typename ValueOf>
  void AddPoint(const ValueOf& value_of) {
    cloud_.points_in_world.emplace_back(value_of(*position_[0]), value_of(*position_[1]),
                                        value_of(*position_[2]));
    if (has_normals()) {
      cloud_.normals.push_back(
          Eigen::Vector3d(value_of(*normal_[0]), value_of(*normal_[1]), value_of(*normal_[2]))
              .cast<float>());
    }
  }

  // The bits of a color are 0xRRGGBB, even where the field is called a float.
  void AddColor(uint32_t bits) {
    cloud_.colors_rgb.push_back({static_cast<uint8_t>(bits >> 16), static_cast<uint8_t>(bits >> 8),
                                 static_cast<uint8_t>(bits)});
  }

  void ReadBinary() {
    const char* point = lines_.rest().data();
    for (uint64_t i = 0; i < header_.count; ++i, point += header_.point_bytes) {
      AddPoint([point](const PcdField& field) { return ValueAt(point + field.at, field); });
      if (color_ != nullptr) AddColor(LoadNumber<uint32_t>(point + color_->at));
    }
  }

  static double ValueAt(const char* bytes, const PcdField& field) {
    if (field.type == 'F') {
      return field.bytes == 4 ? static_cast<double>(LoadNumber<float>(bytes))
                              : LoadNumber<double>(bytes);
    }
    uint64_t bits = 0;
    std::memcpy(&bits, bytes, field.bytes);
    if (field.type == 'U') return static_cast<double>(bits);
    const size_t unused = 64 - 8 * field.bytes;
    return static_cast<double>(static_cast<int64_t>(bits << unused) >> unused);
  }

  void ReadText() {
    while (cloud_.points_in_world.size() < header_.count) {
      if (lines_.rest().empty()) {
        throw InputError(
            path_, fmt::format("point {} of {}", cloud_.points_in_world.size(), header_.count),
            "the file ends early");
      }
      const std::string_view line = lines_.Next();
      if (line.empty()) continue;
      const auto tokens = SplitTokens(line);
      if (tokens.size() != header_.point_tokens) {
        throw InputError(
            path_, fmt::format("line {}", lines_.number()),
            fmt::format("expected {} numbers, found {}", header_.point_tokens, tokens.size()));
      }
      const auto value_of = [&](const PcdField& field) { return Number(tokens, field); };
      AddPoint(value_of);
      if (color_ != nullptr) AddColor(BitsOf(value_of(*color_)));
    }
  }

  double Number(const std::vector<std::string_view>& tokens, const PcdField& field) const {
    const auto value = ParseDouble(tokens[field.token]);
    if (!value) {
      throw InputError(path_, fmt::format("line {}, {}", lines_.number(), field.name),
                       fmt::format("expected a number, found \"{}\"", Shown(tokens[field.token])));
    }
    return *value;
  }

  uint32_t BitsOf(double color) const {
    if (color_->type == 'F') return std::bit_cast<uint32_t>(static_cast<float>(color));
    constexpr double kBeyond = 4294967296;  // of 32 bits
    if (!(std::abs(color) < kBeyond)) {
      throw InputError(path_, fmt::format("line {}, {}", lines_.number(), color_->name),
                       fmt::format("expected a color of 32 bits, found {}", color));
    }
    return static_cast<uint32_t>(static_cast<int64_t>(color));
  }

  const std::filesystem::path& path_;
  PcdLines lines_;
  PcdHeader header_;
  std::array<const PcdField*, 3> position_{};
  std::array<const PcdField*, 3> normal_{};
  const PcdField* color_ = nullptr;
  PointCloud cloud_;
};

}  // namespace

PointCloud ReadPcdCloud(const std::filesystem::path& path, std::string_view contents) {
  return PcdReader(path, contents).Read();
}

}  // namespace raylift
