#include <algorithm>
#include <array>
#include <climits>
#include <cmath>
#include <string_view>

#include "io/hloc/hdf5_file.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/hloc_files.h"

namespace raylift {
namespace {

std::string GroupName(const std::string& first, const std::string& second, char separator) {
  std::string name = first;
  std::replace(name.begin(), name.end(), '/', '-');
  name += separator;
  const size_t begin = name.size();
  name += second;
  std::replace(name.begin() + static_cast<ptrdiff_t>(begin), name.end(), '/', '-');
  return name;
}

constexpr char kNewSeparator = '/';
constexpr char kOldSeparator = '_';

std::vector<int64_t> ReadIndices(const Hdf5Reader& file, const std::string& group) {
  const std::string dataset = group + "/matches0";
  auto array = file.Read<int64_t>(dataset);
  if (array.shape.size() != 1) {
    file.Fail(dataset, fmt::format("expected a vector, found {} dimensions", array.shape.size()));
  }
  for (size_t i = 0; i < array.values.size(); ++i) {
    if (array.values[i] < -1 || array.values[i] > INT_MAX) {
      file.Fail(dataset, fmt::format("expected an index or -1, found {} for keypoint {} (indices "
                                     "beyond 32767 overflow in files of 16-bit indices)",
                                     array.values[i], i));
    }
  }
  return std::move(array.values);
}

// Reads the scores; hloc's matchers may leave them out, and all matches count the same then.
std::vector<float> ReadMatchScores(const Hdf5Reader& file, const std::string& group,
                                   size_t num_indices) {
  const std::string dataset = group + "/matching_scores0";
  if (!file.Has(dataset)) {
    return std::vector<float>(num_indices, 1.0f);
  }
  auto array = file.Read<float>(dataset);
  if (array.shape.size() != 1 || array.shape[0] != num_indices) {
    file.Fail(dataset, fmt::format("expected {} numbers as in matches0, found {}", num_indices,
                                   array.values.size()));
  }
  for (const float score : array.values) {
    if (!std::isfinite(score)) {
      file.Fail(dataset, fmt::format("expected finite numbers, found {}", score));
    }
  }
  return std::move(array.values);
}

enum class Direction { kAsAsked, kReversed };

std::vector<FeatureMatch> ReadMatches(const Hdf5Reader& file, const std::string& group,
                                      Direction direction) {
  const std::vector<int64_t> indices = ReadIndices(file, group);
  const std::vector<float> scores = ReadMatchScores(file, group, indices.size());
  std::vector<FeatureMatch> matches;
  for (size_t i = 0; i < indices.size(); ++i) {
    if (indices[i] == -1) {
      continue;
    }
    const int first = static_cast<int>(i);
    const int second = static_cast<int>(indices[i]);
    matches.push_back(direction == Direction::kAsAsked ? FeatureMatch{first, second, scores[i]}
                                                       : FeatureMatch{second, first, scores[i]});
  }
  return matches;
}

// Splits "query, reference[, score]" at commas that separate, else at white space.
std::vector<std::string_view> SplitPairLine(std::string_view line) {
  const bool has_blank = line.find_first_of(" \t") != std::string_view::npos;
  const bool has_comma = line.find(',') != std::string_view::npos;
  const bool has_comma_and_blank = line.find(", ") != std::string_view::npos;
  if (has_comma_and_blank || (has_comma && !has_blank)) {
    return SplitBy(line, ',');
  }
  return SplitTokens(line);
}

bool IsName(const std::string& name) {
  return !name.empty() && !name.starts_with('#') &&
         name.find_first_of(",\r\n") == std::string::npos && Trim(name) == name;
}

}  // namespace

struct MatchFile::Impl {
  explicit Impl(const std::filesystem::path& path) : file(path) {}
  Hdf5Reader file;
};

MatchFile::MatchFile(const std::filesystem::path& path) : impl_(std::make_unique<Impl>(path)) {}
MatchFile::~MatchFile() = default;
MatchFile::MatchFile(MatchFile&&) noexcept = default;
MatchFile& MatchFile::operator=(MatchFile&&) noexcept = default;

std::optional<std::vector<FeatureMatch>> MatchFile::Read(const std::string& query_name,
                                                         const std::string& reference_name) const {
  for (const char separator : {kNewSeparator, kOldSeparator}) {
    for (const Direction direction : {Direction::kAsAsked, Direction::kReversed}) {
      const std::string group = direction == Direction::kAsAsked
                                    ? GroupName(query_name, reference_name, separator)
                                    : GroupName(reference_name, query_name, separator);
      if (impl_->file.Has(group)) {
        return ReadMatches(impl_->file, group, direction);
      }
    }
  }
  return std::nullopt;
}

RetrievalPairs ReadPairs(const std::filesystem::path& path) {
  RetrievalPairs pairs;
  LineReader lines(path);
  while (const auto line = lines.NextContent()) {
    const auto parts = SplitPairLine(Trim(*line));
    if (parts.size() < 2 || parts.size() > 3 || parts[0].empty() || parts[1].empty()) {
      lines.Fail(
          fmt::format("expected \"query reference\" or \"query, reference, score\", found "
                      "\"{}\"",
                      Trim(*line)));
    }
    if (parts.size() == 3) {
      lines.Double(parts[2], "score");
    }
    std::vector<std::string>& references = pairs[std::string(parts[0])];
    if (std::find(references.begin(), references.end(), parts[1]) == references.end()) {
      references.emplace_back(parts[1]);
    }
  }
  return pairs;
}

void WritePairs(const std::filesystem::path& path,
                std::span<const std::pair<std::string, std::string>> pairs) {
  std::string text;
  for (const auto& [query, reference] : pairs) {
    for (const std::string& name : {query, reference}) {
      if (!IsName(name)) {
        throw InputError(path, fmt::format("the file cannot hold the name \"{}\"", name));
      }
    }
    const bool has_blank = (query + reference).find_first_of(" \t\v\f") != std::string::npos;
    text += fmt::format("{}{} {}\n", query, has_blank ? "," : "", reference);
  }
  WriteFile(path, text);
}

}  // namespace raylift
