// Reads points as text, one a line: "x y z" and further columns, separated by blanks, commas or
// semicolons.

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "base/input_paths.h"
#include "surfaces/file_readers.h"
#include "surfaces/input_files.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/scene/image.h"

namespace raylift {
namespace {

// Columns without names are told apart by so many lines.
constexpr size_t kSampleLines = 100;

struct Columns {
  size_t count = 0;  // in a line
  std::array<size_t, 3> position = {0, 1, 2};
  std::optional<std::array<size_t, 3>> color;
  std::optional<std::array<size_t, 3>> normal;
};

bool IsSeparator(char c) { return c == ' ' || c == '\t' || c == '\r' || c == ',' || c == ';'; }

void Split(std::string_view line, std::vector<std::string_view>& tokens) {
  tokens.clear();
  size_t i = 0;
  while (true) {
    while (i < line.size() && IsSeparator(line[i])) ++i;
    if (i == line.size()) return;
    const size_t begin = i;
    while (i < line.size() && !IsSeparator(line[i])) ++i;
    tokens.push_back(line.substr(begin, i - begin));
  }
}

std::optional<std::array<size_t, 3>> FindNames(
    const std::vector<std::string>& names,
    std::initializer_list<std::array<std::string_view, 3>> wanted) {
  for (const auto& triple : wanted) {
    std::array<size_t, 3> columns{};
    bool found = true;
    for (size_t k = 0; k < 3 && found; ++k) {
      const auto place = std::find(names.begin(), names.end(), triple[k]);
      found = place != names.end();
      columns[k] = static_cast<size_t>(place - names.begin());
    }
    if (found) return columns;
  }
  return std::nullopt;
}

class TextCloudReader {
 public:
  TextCloudReader(const std::filesystem::path& path, std::string_view text)
      : path_(path), text_(text) {}

  PointCloud Read() {
    SkipHead();
    if (!named_) GuessColumns();
    while (NextLine()) {
      if (tokens_.empty() || IsComment()) continue;
      ReadPoint();
    }
    return std::move(cloud_);
  }

 private:
  bool NextLine() {
    if (next_ >= text_.size()) return false;
    const size_t end = std::min(text_.find('\n', next_), text_.size());
    Split(text_.substr(next_, end - next_), tokens_);
    next_ = end + 1;
    ++line_number_;
    return true;
  }

  bool IsComment() const {
    return tokens_.front().starts_with('#') || tokens_.front().starts_with("//");
  }

  // Skips what stands before the first point: comments, the columns' names, and the number of
  // points of a .pts file.
  void SkipHead() {
    while (true) {
      const size_t begin = next_;
      if (!NextLine()) return;
      if (tokens_.empty()) continue;
      const bool is_number = ParseDouble(tokens_.front()).has_value();
      if (is_number && tokens_.size() > 1) {
        next_ = begin;
        --line_number_;
        return;
      }
      if (is_number) continue;
      if (!TakeNames() && !IsComment()) Fail(0, "x");
    }
  }

  // Takes the columns by the names that the line has; returns false where its words do not name
  // columns.
  bool TakeNames() {
    std::vector<std::string> names;
    for (std::string_view token : tokens_) {
      while (token.starts_with('/') || token.starts_with('#')) token.remove_prefix(1);
      if (!token.empty()) names.push_back(Lower(token));
    }
    const auto position = FindNames(names, {{"x", "y", "z"}});
    if (!position) return false;
    named_ = true;
    columns_ = {
        .count = names.size(),
        .position = *position,
        .color = FindNames(names, {{"r", "g", "b"}, {"red", "green", "blue"}}),
        .normal = FindNames(names, {{"nx", "ny", "nz"}, {"normal_x", "normal_y", "normal_z"}})};
    return true;
  }

  void GuessColumns() {
    const size_t begin = next_;
    const int line_number = line_number_;
    std::vector<std::vector<double>> sample;
    while (sample.size() < kSampleLines && NextLine()) {
      if (tokens_.empty() || IsComment()) continue;
      std::vector<double> values;
      for (const std::string_view token : tokens_) {
        values.push_back(ParseDouble(token).value_or(std::nan("")));
      }
      if (!sample.empty()) values.resize(std::min(values.size(), sample.front().size()));
      sample.push_back(std::move(values));
    }
    next_ = begin;
    line_number_ = line_number;
    if (sample.empty()) return;
    columns_.count = std::max(columns_.position.size(), sample.front().size());
    for (size_t c = 3; c + 3 <= columns_.count; ++c) {
      const std::array<size_t, 3> triple = {c, c + 1, c + 2};
      if (!columns_.normal && AllAre(sample, c, IsUnit)) {
        columns_.normal = triple;
      } else if (!columns_.color && AllAre(sample, c, IsColor)) {
        columns_.color = triple;
      } else {
        continue;
      }
      c += 2;
    }
  }

  using Kind = bool (*)(const Eigen::Vector3d&);
  static bool AllAre(const std::vector<std::vector<double>>& sample, size_t column, Kind kind) {
    return std::all_of(sample.begin(), sample.end(), [&](const std::vector<double>& line) {
      return column + 3 <= line.size() && kind({line[column], line[column + 1], line[column + 2]});
    });
  }
  static bool IsUnit(const Eigen::Vector3d& v) {
    constexpr double kPrinted = 0.01;  // what few decimals round
    return std::abs(v.norm() - 1) < kPrinted;
  }
  static bool IsColor(const Eigen::Vector3d& v) {
    return (v.array() >= 0 && v.array() <= 255 && v.array() == v.array().round()).all();
  }

  void ReadPoint() {
    if (tokens_.size() < columns_.count) {
      throw InputError(
          path_, fmt::format("line {}", line_number_),
          fmt::format("expected {} columns, found {}", columns_.count, tokens_.size()));
    }
    cloud_.points_in_world.push_back(Take(columns_.position, {"x", "y", "z"}));
    if (columns_.color) {
      const Eigen::Vector3d rgb = Take(*columns_.color, {"red", "green", "blue"});
      cloud_.colors_rgb.push_back({NearestByte(rgb[0]), NearestByte(rgb[1]), NearestByte(rgb[2])});
    }
    if (columns_.normal) {
      cloud_.normals.push_back(
          Take(*columns_.normal, {"normal x", "normal y", "normal z"}).cast<float>());
    }
  }

  Eigen::Vector3d Take(const std::array<size_t, 3>& columns,
                       const std::array<std::string_view, 3>& fields) const {
    Eigen::Vector3d values;
    for (size_t k = 0; k < 3; ++k) {
      const auto value = ParseDouble(tokens_[columns[k]]);
      if (!value) Fail(columns[k], fields[k]);
      values[static_cast<Eigen::Index>(k)] = *value;
    }
    return values;
  }

  [[noreturn]] void Fail(size_t column, std::string_view field) const {
    throw InputError(path_, fmt::format("line {}, {}", line_number_, field),
                     fmt::format("expected a number, found \"{}\"", Shown(tokens_[column])));
  }

  const std::filesystem::path& path_;
  std::string_view text_;
  size_t next_ = 0;
  int line_number_ = 0;
  std::vector<std::string_view> tokens_;  // of the current line
  bool named_ = false;
  Columns columns_{.count = 3, .position = {0, 1, 2}, .color = {}, .normal = {}};
  PointCloud cloud_;
};

}  // namespace

PointCloud ReadTextCloud(const std::filesystem::path& path, std::string_view contents) {
  return TextCloudReader(path, contents).Read();
}

}  // namespace raylift
