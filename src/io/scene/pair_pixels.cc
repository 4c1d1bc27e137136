#include "io/scene/pair_pixels.h"

#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "io/binary/array_file.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using std::filesystem::path;
using Array = NpyArray<double>;

constexpr std::pair<const char*, const char*> kPixelNames[] = {
    {"mkpts0", "mkpts1"}, {"kpts0", "kpts1"}, {"keypoints0", "keypoints1"}};
constexpr std::string_view kHalf = "float16";
constexpr const char* kScoreNames[] = {
    "scores", "conf", "confidence", "mconf", "match_confidence", "matching_scores0", "certainty"};

bool HasColumns(const Array& array, uint64_t columns) {
  return array.shape.size() == 2 && array.shape[1] == columns;
}
bool AreRows(const Array& array) { return HasColumns(array, 4) || HasColumns(array, 5); }

Eigen::Vector2d PixelAt(const ArrayFile& arrays, const std::string& name, const Array& array,
                        size_t row, size_t column) {
  const size_t at = row * array.shape[1] + column;
  const Eigen::Vector2d pixel(array.values[at], array.values[at + 1]);
  if (!pixel.allFinite()) {
    arrays.Fail(name, fmt::format("row {}: expected finite numbers, found {} {}", row, pixel.x(),
                                  pixel.y()));
  }
  return pixel;
}

// Returns a score for each match; empty where the file has none.
std::vector<double> Scores(const ArrayFile& arrays, size_t count) {
  for (const char* name : kScoreNames) {
    if (!arrays.Has(name)) continue;
    std::vector<double> scores = arrays.Read<double>(name).values;
    if (scores.size() != count) {
      arrays.Fail(name, fmt::format("expected {} scores, one of each match, found {}", count,
                                    scores.size()));
    }
    return scores;
  }
  return {};
}

PairPixels FromRows(const ArrayFile& arrays, const std::string& name, const Array& rows) {
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

std::vector<Eigen::Vector2d> Pixels(const ArrayFile& arrays, const std::string& name,
                                    bool& is_half) {
  const Array array = arrays.Read<double>(name);
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

const Eigen::Vector2d& Indexed(const ArrayFile& arrays, const std::string& name,
                               const std::vector<Eigen::Vector2d>& pixels, double index) {
  if (!(index >= 0 && index < static_cast<double>(pixels.size()) && index == std::floor(index))) {
    arrays.Fail(name, fmt::format("expected an index below {}, the number of keypoints, found {}",
                                  pixels.size(), index));
  }
  return pixels[static_cast<size_t>(index)];
}

// Returns the matched ones of all keypoints, which `keypoints` holds.
PairPixels Matched(const ArrayFile& arrays, const std::string& name, const PairPixels& keypoints) {
  const Array indices = arrays.Read<double>(name);
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

PairPixels FromTwoLists(const ArrayFile& arrays, const std::string& first,
                        const std::string& second) {
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
  const ArrayFile arrays(file);
  if (arrays.Has("matches")) {
    const Array matches = arrays.Read<double>("matches");
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
  const Array only = arrays.Read<double>(name);
  if (only.values.empty()) return {};
  if (!AreRows(only)) arrays.FailShape(name, only, "N x 4 numbers, or 5 with a score");
  return FromRows(arrays, name, only);
}

}  // namespace raylift
