#include "raylift/io/retrieval_pairs.h"

#include <algorithm>
#include <string_view>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

// "query, reference[, score]" where there are commas that separate, else by white space.
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
         name.find_first_of(" \t\r\n\v\f,") == std::string::npos;
}

}  // namespace

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
    text += fmt::format("{} {}\n", query, reference);
  }
  WriteFile(path, text);
}

}  // namespace raylift
