// A TOML text as a tree, whichever library parses it.

#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <variant>
#include <vector>

namespace raylift {

// The deepest nesting of tables and lists: more would exhaust the stack.
inline constexpr int kDeepestToml = 256;

struct TomlNode {
  using Array = std::vector<TomlNode>;
  using Table = std::map<std::string, TomlNode, std::less<>>;

  // std::monostate is a date or a time.
  std::variant<std::monostate, std::string, int64_t, double, bool, Array, Table> value;
  int line = 1;

  // Returns the value; null where it is of another kind.
  template <typename Kind>
  const Kind* As() const {
    return std::get_if<Kind>(&value);
  }
};

// Returns the table of the whole text. Throws InputError, which names the file and the line, where
// it is no TOML or nested too deeply.
TomlNode ParseToml(const std::string& text, const std::filesystem::path& file);

}  // namespace raylift
