// The parts of a specification "kind:PATH,key=value,..." by key.

#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/lifting/geometry_source.h"

namespace raylift {

class SpecKeys {
 public:
  // Splits at commas: the first part is the path, each other one a key and its value. OptionError
  // where a part has no "=" or a key stands twice.
  SpecKeys(std::string spec, std::string_view rest);

  const std::string& path() const { return path_; }

  bool Has(const std::string& key) const { return values_.contains(key); }

  // The value of a key, which then is taken.
  std::optional<std::string> Take(const std::string& key);
  // The same, as numbers; OptionError where they are none or below the minimum.
  std::optional<double> TakeNumber(const std::string& key, double minimum);
  std::vector<double> TakeNumbers(const std::string& key);  // separated by "/"

  // The same, as the enum's value of that name; OptionError where it has none.
  template <NamedEnum Enum>
  std::optional<Enum> TakeNamed(const std::string& key) {
    const auto text = Take(key);
    if (!text) return std::nullopt;
    const auto value = FromName<Enum>(*text);
    if (!value) Fail("expected " + key + "=" + NameList<Enum>());
    return value;
  }

  // The limits that all surfaces have: near, far, max_incidence_deg, max_depth_jump.
  void TakeLimits(SurfaceLimits& limits);

  // OptionError where a key was not taken: `known` says which there are.
  void ExpectAllTaken(std::string_view known) const;

  [[noreturn]] void Fail(std::string_view constraint) const;

 private:
  std::string spec_;
  std::string path_;
  std::map<std::string, std::string> values_;
};

}  // namespace raylift
