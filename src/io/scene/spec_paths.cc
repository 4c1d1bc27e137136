#include "io/scene/spec_paths.h"

#include <algorithm>
#include <span>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "raylift/base/text.h"

namespace raylift {

using std::filesystem::path;

std::string MapSpecPaths(const std::string& spec, const std::function<path(const path&)>& move) {
  const std::vector<std::string_view> parts = SplitBy(spec, ',');
  const size_t colon = parts.front().find(':');
  if (colon == std::string_view::npos || colon + 1 == parts.front().size()) return spec;
  const auto moved = [&move](std::string_view file) {
    return file.empty() ? std::string() : move(file).string();
  };
  std::vector<std::string> files;
  for (const std::string_view file : SplitBy(parts.front().substr(colon + 1), '+')) {
    files.push_back(moved(file));
  }
  std::string all = fmt::format("{}{}", parts.front().substr(0, colon + 1), fmt::join(files, "+"));
  for (const std::string_view part : std::span(parts).subspan(1)) {
    const size_t equals = std::min(part.find('='), part.size());
    const std::string_view key = part.substr(0, equals);
    const bool is_file =
        key == "ortho" || key == "names" || (key == "transform" && part.substr(equals) != "=none");
    all += is_file
               ? fmt::format(",{}={}", key, moved(part.substr(std::min(equals + 1, part.size()))))
               : fmt::format(",{}", part);
  }
  return all;
}

}  // namespace raylift
