#include "io/scene/pair_pixels.h"

#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "io/binary/npy_array.h"
#include "io/binary/zip_archive.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr const char* kOnlyArray = "";  // the name of what is in an NPY

constexpr std::pair<const char*, const char*> kPixelNames[] = {
    {"mkpts0", "mkpts1"}, {"kpts0", "kpts1"}, {"keypoints0", "keypoints1"}};
constexpr std::string_view kHalf = "float16";
constexpr const char* kScoreNames[] = {
    "scores", "conf", "confidence", "mconf", "match_confidence", "matching_scores0", "certainty"};

// The arrays of a file by name; decoded when they are asked for, as others beside those that are
// wanted need not be numbers.
class Arrays {
 public:
  explicit Arrays(const path& file) : file_(file), bytes_(ReadFile(file)) {
    if (!IsZip(bytes_)) {
      names_ = {kOnlyArray};
      return;
    }
    archive_.emplace(file, bytes_);
    for (const std::string& name : archive_->names()) {
      if (name.ends_with(".npy")) names_.insert(name.substr(0, name.size() - 4));
    }
  }

  bool Has(const std::string& name) const { return names_.contains(name); }
  const std::set<std::string>& names() const { return names_; }

  // A batch of one is its one.
  NpyArray Read(const std::string& name) const {
    NpyArray array =
        DecodeNpyArray(file_, archive_ ? archive_->Read(name + ".npy") : std::string_view(bytes_));
    while (array.shape.size() > 2 && array.shape.front() == 1) {
      array.shape.erase(array.shape.begin());
    }
    return array;
  }

  [[noreturn]] void Fail(const std::string& name, const std::string& message) const {
    if (name == kOnlyArray) throw InputError(file_, message);
    throw InputError(file_, name, message);
  }
  [[noreturn]] void FailShape(const std::string& name, const NpyArray& array,
                              const char* expected) const {
    Fail(name, fmt::format("expected {}, found an array of shape ({})", expected,
                           fmt::join(array.shape, ", ")));
  }

 private:
  path file_;
  std::string bytes_;
  std::optional<ZipReader> archive_;
  std::set<std::string> names_;
};

bool HasColumns(const NpyArray& array, uint64_t columns) {
  return array.shape.size() == 2 && array.shape[1] == columns;
}
bool AreRows(const NpyArray& array) { return HasColumns(array, 4) || HasColumns(array, 5); }

Eigen::Vector2d PixelAt(const Arrays& arrays, const std::string& name, const NpyArray& array,
                        size_t row, size_t column) {
  const size_t at = row * array.shape[1] + column;
  const Eigen::Vector2d pixel(array.values[at], array.values[at + 1]);
  if (!pixel.allFinite()) {
    arrays.Fail(name, fmt::format("row {}: expected finite numbers, found {} {}", row, pixel.x(),
                                  pixel.y()));
  }
  return pixel;
}

// A score of each match, or none.
std::vector<double> Scores(const Arrays& arrays, size_t count) {
  for (const char* name : kScoreNames) {
    if (!arrays.Has(name)) continue;
    std::vector<double> scores = arrays.Read(name).values;
    if (scores.size() != count) {
      arrays.Fail(name, fmt::format("expected {} scores, one of each match, found {}", count,
                                    scores.size()));
    }
    return scores;
  }
  return {};
}

PairPixels FromRows(const Arrays& arrays, const std::string& name, const NpyArray& rows) {
  PairPixels pair;
  pair.is_half = rows.sample_type == kHalf;
  for (size_t row = 0; row < rows.shape[0]; ++row) {
    pair.first_px.push_back(PixelAt(arrays, name, rows, row, 0));
    pair.second_px.push_back(PixelAt(arrays, name, rows, row, 2));
    if (HasColumns(rows, 5)) pair.scores.push_back(rows.values[row * 5 + 4]);
  }
  if (HasColumns(rows, 4)) pair.scores = Scores(arrays, rows.shape[0]);
  return pair;
}

std::vector<Eigen::Vector2d> Pixels(const Arrays& arrays, const std::string& name, bool& is_half) {
  const NpyArray array = arrays.Read(name);
  is_half = is_half || array.sample_type == kHalf;
  // A matcher that found nothing may leave a vector of nothing.
  if (array.values.empty()) return {};
  if (!HasColumns(array, 2)) arrays.FailShape(name, array, "N x 2 numbers");
  std::vector<Eigen::Vector2d> pixels;
  pixels.reserve(array.shape[0]);
  for (size_t row = 0; row < array.shape[0]; ++row) {
    pixels.push_back(PixelAt(arrays, name, array, row, 0));
  }
  return pixels;
}

const Eigen::Vector2d& Indexed(const Arrays& arrays, const std::string& name,
                               const std::vector<Eigen::Vector2d>& pixels, double index) {
  if (!(index >= 0 && index < static_cast<double>(pixels.size()) && index == std::floor(index))) {
    arrays.Fail(name, fmt::format("expected an index below {}, the number of keypoints, found {}",
                                  pixels.size(), index));
  }
  return pixels[static_cast<size_t>(index)];
}

// Returns the matched ones of all keypoints, which `keypoints` holds.
PairPixels Matched(const Arrays& arrays, const std::string& name, const PairPixels& keypoints) {
  const NpyArray indices = arrays.Read(name);
  const bool in_pairs = HasColumns(indices, 2);
  const size_t count = in_pairs ? indices.shape[0] : indices.values.size();
  if (!in_pairs && count != keypoints.first_px.size()) {
    arrays.FailShape(name, indices, "K x 2 indices, or one of each keypoint of the first image");
  }
  const std::vector<double> scores = Scores(arrays, count);
  PairPixels pair;
  pair.is_half = keypoints.is_half;
  for (size_t i = 0; i < count; ++i) {
    const double first = in_pairs ? indices.values[2 * i] : static_cast<double>(i);
    const double second = indices.values[in_pairs ? 2 * i + 1 : i];
    if (!in_pairs && second == -1) continue;
    pair.first_px.push_back(Indexed(arrays, name, keypoints.first_px, first));
    pair.second_px.push_back(Indexed(arrays, name, keypoints.second_px, second));
    if (!scores.empty()) pair.scores.push_back(scores[i]);
  }
  return pair;
}

PairPixels FromTwoLists(const Arrays& arrays, const std::string& first, const std::string& second) {
  PairPixels pair;
  pair.first_px = Pixels(arrays, first, pair.is_half);
  pair.second_px = Pixels(arrays, second, pair.is_half);
  if (first == "keypoints0") {
    for (const char* name : {"matches0", "matches"}) {
      if (arrays.Has(name)) return Matched(arrays, name, pair);
    }
  }
  if (pair.first_px.size() != pair.second_px.size()) {
    arrays.Fail(second, fmt::format("expected {} pixels as in {}, found {}", pair.first_px.size(),
                                    first, pair.second_px.size()));
  }
  pair.scores = Scores(arrays, pair.first_px.size());
  return pair;
}

}  // namespace

bool IsPairFileName(const path& file) {
  return file.extension() == ".npy" || file.extension() == ".npz";
}

PairPixels ReadPairPixels(const path& file) {
  const Arrays arrays(file);
  if (arrays.Has("matches")) {
    const NpyArray matches = arrays.Read("matches");
    if (AreRows(matches)) return FromRows(arrays, "matches", matches);
  }
  for (const auto& [first, second] : kPixelNames) {
    if (arrays.Has(first) && arrays.Has(second)) return FromTwoLists(arrays, first, second);
  }
  if (arrays.names().size() != 1) {
    throw InputError(file,
                     fmt::format("expected matches (N x 4), mkpts0 and mkpts1, or keypoints0 and "
                                 "keypoints1, found {}",
                                 fmt::join(arrays.names(), ", ")));
  }
  const std::string& name = *arrays.names().begin();
  const NpyArray only = arrays.Read(name);
  if (only.values.empty()) return {};
  if (!AreRows(only)) arrays.FailShape(name, only, "N x 4 numbers, or 5 with a score");
  return FromRows(arrays, name, only);
}

}  // namespace raylift
