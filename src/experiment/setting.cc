#include "raylift/experiment/setting.h"

#include <algorithm>

namespace raylift {
namespace {

constexpr std::array<std::string_view, kNumAxes> kNames = {
    "scene", "every", "geometry", "align", "filter", "method", "score", "lo", "alpha"};

}  // namespace

std::string_view ToString(Axis axis) { return kNames[static_cast<size_t>(axis)]; }

std::optional<Axis> AxisFromName(std::string_view name) {
  const auto found = std::find(kNames.begin(), kNames.end(), name);
  if (found == kNames.end()) return std::nullopt;
  return kAllAxes[static_cast<size_t>(found - kNames.begin())];
}

std::string AxisNames() {
  std::string names;
  for (const std::string_view name : kNames) {
    if (!names.empty()) names += '|';
    names += name;
  }
  return names;
}

std::string Setting::Name() const {
  std::string name;
  for (const Axis axis : kAllAxes) {
    const std::string& value = (*this)[axis];
    if (value.empty()) continue;
    if (!name.empty()) name += ' ';
    name += ToString(axis);
    name += '=';
    name += value;
  }
  return name;
}

bool Selection::Matches(const Setting& setting) const {
  return std::all_of(values.begin(), values.end(), [&](const auto& entry) {
    const std::string& value = setting[entry.first];
    return value.empty() ||
           std::find(entry.second.begin(), entry.second.end(), value) != entry.second.end();
  });
}

}  // namespace raylift
