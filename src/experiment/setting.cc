#include "raylift/experiment/setting.h"

#include <algorithm>

namespace raylift {
namespace {}  // namespace

std::string Setting::Name() const {
  std::string name;
  for (const Axis axis : AllValues<Axis>()) {
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
