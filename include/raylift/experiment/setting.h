// One way to localize, as a point of an experiment's grid: a value on each axis. All values are
// texts, as the experiment's file and its tables name them.

#pragma once

#include <array>
#include <compare>
#include <cstddef>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/base/enum_names.h"

namespace raylift {

enum class Axis { kScene, kEvery, kGeometry, kAlign, kFilter, kMethod, kScore, kLo, kAlpha };
template <>
inline constexpr auto kEnumNames<Axis> = std::to_array<EnumName<Axis>>({
    {Axis::kScene, "scene", "Scene"},
    {Axis::kEvery, "every", "References"},
    {Axis::kGeometry, "geometry", "Geometry"},
    {Axis::kAlign, "align", "Alignment"},
    {Axis::kFilter, "filter", "Filter"},
    {Axis::kMethod, "method", "Method"},
    {Axis::kScore, "score", "Scoring"},
    {Axis::kLo, "lo", "LO"},
    {Axis::kAlpha, "alpha"},
});
constexpr size_t kNumAxes = kEnumNames<Axis>.size();

// The axes that say what the method is, and not what it is given.
constexpr bool IsOfMethod(Axis axis) { return axis >= Axis::kMethod; }

// The name of the oracle, which is chosen from the results of P3P and E5+1.
constexpr std::string_view kOracle = "oracle";

struct Setting {
  // Empty: does not matter here (E5+1 needs no geometry, P3P has no score).
  std::array<std::string, kNumAxes> values;

  std::string& operator[](Axis axis) { return values[static_cast<size_t>(axis)]; }
  const std::string& operator[](Axis axis) const { return values[static_cast<size_t>(axis)]; }
  auto operator<=>(const Setting&) const = default;

  // "scene=demo every=5 ..." of the values that matter.
  std::string Name() const;
};

// Values that settings may have on some axes; an axis that is not named may have any.
struct Selection {
  std::map<Axis, std::vector<std::string>> values;

  // A value that does not matter to the setting matches.
  bool Matches(const Setting& setting) const;
};

}  // namespace raylift
