#include "base/name_order.h"

#include <algorithm>
#include <cstddef>
#include <string_view>
#include <utility>
#include <vector>

namespace raylift {
namespace {

// The name with numbers of one length.
std::string OrderKey(std::string_view name) {
  constexpr size_t kLengthOfNumber = 20;
  constexpr std::string_view kAllDigits = "0123456789";
  std::string key;
  while (!name.empty()) {
    std::string_view digits = name.substr(0, name.find_first_not_of(kAllDigits));
    name.remove_prefix(digits.size());
    digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size()));
    if (digits.size() < kLengthOfNumber) key.append(kLengthOfNumber - digits.size(), '0');
    key += digits;
    const std::string_view text = name.substr(0, name.find_first_of(kAllDigits));
    key += text;
    name.remove_prefix(text.size());
  }
  return key;
}

}  // namespace

std::map<std::string, double> PlacesByNumbers(std::span<const std::string> names) {
  std::vector<std::pair<std::string, std::string>> sorted;
  for (const std::string& name : names) sorted.emplace_back(OrderKey(name), name);
  std::sort(sorted.begin(), sorted.end());
  std::map<std::string, double> places;
  for (const auto& [key, name] : sorted) places.emplace(name, static_cast<double>(places.size()));
  return places;
}

}  // namespace raylift
