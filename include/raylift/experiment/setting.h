// One way to localize, as a point of an experiment's grid: a value on each axis. Files, tables and
// the names of cells hold the values' texts.

#pragma once

#include <array>
#include <compare>
#include <cstddef>
#include <map>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/lifting/depth_alignment.h"

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

// Stands for a method: the better pose of P3P's and E5+1's, chosen with the ground truth.
struct Oracle {
  auto operator<=>(const Oracle&) const = default;
};
constexpr std::string_view kOracleName = "oracle";

// A value on an axis:
//   scene, geometry, filter   the name that the experiment gives it
//   every                     size_t
//   method                    Method or Oracle
//   align, score, lo          the enum
//   alpha                     double
// None where the axis does not matter to the setting (E5+1 needs no geometry, P3P has no score).
using AxisValue = std::variant<std::monostate, std::string, size_t, AlignMode, Method, Oracle,
                               ScoreCombination, LocalOptimization, double>;
inline bool Matters(const AxisValue& value) {
  return !std::holds_alternative<std::monostate>(value);
}
// As files and tables have it; empty for none.
std::string TextOf(const AxisValue& value);

struct Setting {
  std::array<AxisValue, kNumAxes> values;

  AxisValue& operator[](Axis axis) { return values[static_cast<size_t>(axis)]; }
  const AxisValue& operator[](Axis axis) const { return values[static_cast<size_t>(axis)]; }
  // What the compiler compares with zero is no pointer.
  auto operator<=>(const Setting&) const = default;  // NOLINT(modernize-use-nullptr)

  // The value on an axis where it matters and is of this type, else null.
  template <typename T>
  const T* Find(Axis axis) const {
    return std::get_if<T>(&(*this)[axis]);
  }
  // The axes that matter to every setting of a grid.
  const std::string& Scene() const { return std::get<std::string>((*this)[Axis::kScene]); }
  size_t Every() const { return std::get<size_t>((*this)[Axis::kEvery]); }
  bool Is(Method method) const { return (*this)[Axis::kMethod] == AxisValue(method); }
  bool IsOracle() const { return Find<Oracle>(Axis::kMethod) != nullptr; }

  // "scene=demo every=5 ..." of the values that matter.
  std::string Name() const;
};

// Values that settings may have on some axes; an axis that is not named may have any.
struct Selection {
  std::map<Axis, std::vector<AxisValue>> values;

  // A value that does not matter to the setting matches.
  bool Matches(const Setting& setting) const;
};

}  // namespace raylift
