// The parts of a specification "kind:PATH,key=value,..." by key. Private to lifting.

#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

class SpecKeys {
 public:
  // Splits at commas: the first part is the path, each other one a key and its value. OptionError
  // where a part has no "=" or a key stands twice.
  SpecKeys(std::string spec, std::string_view rest);

  const std::string& path() const { return path_; }

  // The value of a key, which then is taken.
  std::optional<std::string> Take(const std::string& key);
  // The same, as numbers; OptionError where they are none or below the minimum.
  std::optional<double> TakeNumber(const std::string& key, double minimum);
  std::vector<double> TakeNumbers(const std::string& key);  // separated by "/"

  // OptionError where a key was not taken: `known` says which there are.
  void ExpectAllTaken(std::string_view known) const;

  [[noreturn]] void Fail(std::string_view constraint) const;

 private:
  std::string spec_;
  std::string path_;
  std::map<std::string, std::string> values_;
};

}  // namespace raylift
