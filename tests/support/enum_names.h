// What holds for every table of names of an enum.

#pragma once

#include <cstddef>
#include <set>
#include <string_view>

#include <gtest/gtest.h>

#include "raylift/base/enum_names.h"

namespace raylift {

// Compilers spell a value that has no enumerator as a cast: "(Enum)7".
template <auto kValue>
constexpr bool IsEnumerator() {
  return std::string_view(__PRETTY_FUNCTION__).find("kValue = (") == std::string_view::npos;
}

// The table holds the enumerators 0, 1, ... up to the last one, each under a name of its own that
// leads back to it.
template <NamedEnum Enum>
::testing::AssertionResult NamesEveryValue() {
  constexpr size_t kCount = kEnumNames<Enum>.size();
  if (IsEnumerator<static_cast<Enum>(kCount)>()) {
    return ::testing::AssertionFailure() << "value " << kCount << " has no name";
  }
  std::set<std::string_view> names;
  for (size_t i = 0; i < kCount; ++i) {
    const auto value = static_cast<Enum>(i);
    const std::string_view name = ToString(value);
    if (kEnumNames<Enum>[i].value != value) {
      return ::testing::AssertionFailure() << "entry " << i << " is of another value";
    }
    if (name.empty() || TitleOf(value).empty() || !names.insert(name).second ||
        FromName<Enum>(name) != value) {
      return ::testing::AssertionFailure() << "value " << i << " is called \"" << name << "\"";
    }
  }
  return ::testing::AssertionSuccess();
}

}  // namespace raylift
