// The names of an enum's values: one table, beside the enum, is what options, help, error texts,
// files and result tables go by.
//
//   enum class FilterMode { kOff, kFixed };
//   template <>
//   inline constexpr auto kEnumNames<FilterMode> = std::to_array<EnumName<FilterMode>>({
//       {FilterMode::kOff, "off"},
//       {FilterMode::kFixed, "fixed"},
//   });
//
//   ToString(FilterMode::kOff)       "off"
//   FromName<FilterMode>("fixed")    FilterMode::kFixed
//   NameList<FilterMode>()           "off|fixed"
//   AllValues<FilterMode>()          {FilterMode::kOff, FilterMode::kFixed}

#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace raylift {

template <typename Enum>
struct EnumName {
  Enum value;
  std::string_view name;              // on the command line and in files
  std::string_view title = {};        // for readers, where it is another: "E5+1"
  std::string_view description = {};  // one line of help
};

// Lists every value once, in the order of help texts. An enum with an empty table has no names.
template <typename Enum>
inline constexpr std::array<EnumName<Enum>, 0> kEnumNames = {};

template <typename Enum>
concept NamedEnum = !kEnumNames<Enum>.empty();

template <NamedEnum Enum>
constexpr std::string_view ToString(Enum value) {
  for (const EnumName<Enum>& entry : kEnumNames<Enum>) {
    if (entry.value == value) return entry.name;
  }
  return {};
}

template <NamedEnum Enum>
constexpr std::string_view TitleOf(Enum value) {
  for (const EnumName<Enum>& entry : kEnumNames<Enum>) {
    if (entry.value == value) return entry.title.empty() ? entry.name : entry.title;
  }
  return {};
}

// Returns the value of this name; nullopt if the name is not in the table.
template <NamedEnum Enum>
constexpr std::optional<Enum> FromName(std::string_view name) {
  for (const EnumName<Enum>& entry : kEnumNames<Enum>) {
    if (entry.name == name) return entry.value;
  }
  return std::nullopt;
}

template <NamedEnum Enum>
constexpr auto AllValues() {
  std::array<Enum, kEnumNames<Enum>.size()> values{};
  for (size_t i = 0; i < values.size(); ++i) values[i] = kEnumNames<Enum>[i].value;
  return values;
}

// Returns "off|fixed", for help and error texts.
template <NamedEnum Enum>
std::string NameList() {
  std::string list;
  for (const EnumName<Enum>& entry : kEnumNames<Enum>) {
    if (!list.empty()) list += '|';
    list += entry.name;
  }
  return list;
}

}  // namespace raylift
