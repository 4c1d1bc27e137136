#include "raylift/experiment/setting.h"

#include <algorithm>

#include "raylift/base/text.h"

namespace raylift {
namespace {

struct ToText {
  std::string operator()(std::monostate) const { return {}; }
  std::string operator()(const std::string& name) const { return name; }
  std::string operator()(size_t count) const { return std::to_string(count); }
  std::string operator()(double number) const { return FormatDouble(number); }
  std::string operator()(Oracle) const { return std::string(kOracleName); }
  template <NamedEnum Enum>
  std::string operator()(Enum value) const {
    return std::string(ToString(value));
  }
};

}  // namespace

std::string TextOf(const AxisValue& value) { return std::visit(ToText(), value); }

std::string Setting::Name() const {
  std::string name;
  for (const Axis axis : AllValues<Axis>()) {
    const AxisValue& value = (*this)[axis];
    if (!Matters(value)) continue;
    if (!name.empty()) name += ' ';
    name += ToString(axis);
    name += '=';
    name += TextOf(value);
  }
  return name;
}

bool Selection::Matches(const Setting& setting) const {
  return std::all_of(values.begin(), values.end(), [&](const auto& entry) {
    const AxisValue& value = setting[entry.first];
    return !Matters(value) ||
           std::find(entry.second.begin(), entry.second.end(), value) != entry.second.end();
  });
}

}  // namespace raylift
