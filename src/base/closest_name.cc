#include "raylift/base/closest_name.h"

#include <algorithm>
#include <vector>

#include <fmt/format.h>

namespace raylift {

size_t EditDistance(std::string_view a, std::string_view b) {
  // Of the first i letters of a to the first j of b, for the last three i.
  std::vector<size_t> before(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
  for (size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (size_t i = 1; i <= a.size(); ++i) {
    std::swap(before, last);
    std::swap(last, row);
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      const size_t changed = last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      row[j] = std::min({changed, last[j] + 1, row[j - 1] + 1});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) row[j] = std::min(row[j], before[j - 2] + 1);
    }
  }
  return row[b.size()];
}

std::optional<std::string> ClosestName(std::string_view typed, std::span<const std::string> names) {
  std::optional<std::string> closest;
  size_t least = 0;
  for (const std::string& name : names) {
    const size_t distance = EditDistance(typed, name);
    if (3 * distance <= name.size() && (!closest || distance < least)) {
      closest = name;
      least = distance;
    }
  }
  return closest;
}

std::string DidYouMean(std::string_view typed, std::span<const std::string> names) {
  const auto closest = ClosestName(typed, names);
  return closest ? fmt::format("; did you mean {}?", *closest) : "";
}

}  // namespace raylift
