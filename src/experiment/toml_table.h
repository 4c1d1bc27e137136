// A table of a TOML file, read strictly: errors name the file and the key, and a key that nobody
// asked for is one.

#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include <toml++/toml.h>

namespace raylift {

class TomlTable {
 public:
  // Texts go through `expand`, which may throw the message of an error as a std::string.
  using Expand = std::function<std::string(const std::string& text)>;

  // `place` is the table's own key ("scenes.demo"), empty at the top.
  TomlTable(std::filesystem::path file, std::string place, std::shared_ptr<const toml::table> table,
            Expand expand);

  bool Has(std::string_view key) const { return table_->contains(key); }
  bool IsTable(std::string_view key) const;
  std::vector<std::string> Keys() const;
  int LineOf(std::string_view key) const;

  std::optional<std::string> Text(std::string_view key);
  std::string RequiredText(std::string_view key);
  std::optional<double> Number(std::string_view key);
  std::optional<bool> Boolean(std::string_view key);
  std::optional<int64_t> Integer(std::string_view key);
  // One value or a list, of texts and numbers; as texts.
  std::vector<std::string> Values(std::string_view key);
  std::optional<TomlTable> Table(std::string_view key);
  // An array of tables; none: empty.
  std::vector<TomlTable> Tables(std::string_view key);

  // The value of a text that `from_name` knows.
  template <typename T>
  std::optional<T> Named(std::string_view key, std::optional<T> (*from_name)(std::string_view),
                         std::string_view expected) {
    const auto text = Text(key);
    if (!text) return std::nullopt;
    const auto value = from_name(*text);
    if (!value) FailWith(key, expected, *text);
    return value;
  }

  // InputError where a key was not asked for.
  void RequireAllRead() const;

  [[noreturn]] void Fail(std::string_view key, std::string_view message) const;

 private:
  [[noreturn]] void FailWith(std::string_view key, std::string_view expected,
                             std::string_view found) const;
  const toml::node* Find(std::string_view key);
  std::string Expanded(std::string_view key, const std::string& text) const;
  std::string ValueText(std::string_view key, const toml::node& node) const;
  std::string PlaceOf(std::string_view key) const;

  std::filesystem::path file_;
  std::string place_;
  std::shared_ptr<const toml::table> table_;  // a part of the whole file, which it keeps
  Expand expand_;
  std::set<std::string> read_;
};

// InputError with the line where the file is no TOML.
std::shared_ptr<const toml::table> ParseTomlFile(const std::filesystem::path& file);

}  // namespace raylift
