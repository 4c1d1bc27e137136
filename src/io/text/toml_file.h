// Reads a TOML file strictly: errors name the file, the line and the key ("scenes.demo.model"), and
// a key that nobody asked for is one.

#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/fields.h"

#include "raylift/base/enum_names.h"

namespace raylift {

// A table of the file: all of it, or a part, which keeps the whole.
class TomlTable {
 public:
  // Is applied to all strings; an InputError that it throws is rethrown with the string's place.
  using Expand = std::function<std::string(const std::string& text)>;

  ~TomlTable();
  TomlTable(TomlTable&&) noexcept;
  TomlTable& operator=(TomlTable&&) noexcept;

  bool Has(std::string_view key) const;
  bool IsTable(std::string_view key) const;
  // Returns the keys in alphabetical order; LineOf() tells that of the lines.
  std::vector<std::string> Keys() const;
  int LineOf(std::string_view key) const;

  // Return the value of a key, which then counts as read; nullopt where it is not there. Throw
  // InputError where it is of another kind.
  std::optional<std::string> Text(std::string_view key);
  std::string RequiredText(std::string_view key);
  std::optional<double> Number(std::string_view key);
  std::optional<bool> Boolean(std::string_view key);
  std::optional<int64_t> Integer(std::string_view key);
  // Returns one value or a list of strings, numbers and booleans, as texts. A list must not be
  // empty.
  std::vector<std::string> Values(std::string_view key);
  std::optional<TomlTable> Table(std::string_view key);
  // Returns an array of tables; empty where there is none.
  std::vector<TomlTable> Tables(std::string_view key);

  // Returns the value of an enum that a text names.
  template <NamedEnum Enum>
  std::optional<Enum> Named(std::string_view key) {
    const auto text = Text(key);
    if (!text) return std::nullopt;
    const auto value = FromName<Enum>(*text);
    if (!value) FailWith(key, NameList<Enum>(), *text);
    return value;
  }

  // Takes the fields of a struct (base/fields.h) whose names, but for the prefix, are keys, and
  // then checks their ranges.
  template <typename Struct>
  void Take(Struct& values, std::string_view prefix = {}) {
    TakeFields(FieldsOf(values), prefix);
    CheckFields(FieldsOf(values), prefix);
  }
  void TakeFields(std::span<const Field> fields, std::string_view prefix = {});
  void CheckFields(std::span<const Field> fields, std::string_view prefix = {}) const;

  // Returns the keys that were not asked for.
  std::vector<std::string> UnreadKeys() const;
  // Throws InputError where there are any.
  void RequireAllRead() const;

  // Throws "FILE: line N: PLACE.key: message".
  [[noreturn]] void Fail(std::string_view key, std::string_view message) const;
  // Throws "FILE: line N: message", with the line of the key.
  [[noreturn]] void FailAtLineOf(std::string_view key, std::string_view message) const;
  // Throws "FILE: line N: PLACE: message", for the table as a whole.
  [[noreturn]] void FailHere(std::string_view message) const;

 private:
  friend TomlTable ReadToml(const std::filesystem::path& file, Expand expand);

  struct Impl;
  explicit TomlTable(std::unique_ptr<Impl> impl);

  [[noreturn]] void FailWith(std::string_view key, std::string_view expected,
                             std::string_view found) const;

  std::unique_ptr<Impl> impl_;
};

// Throws InputError with the line where the file is no TOML. Without `expand`, texts are as they
// stand.
TomlTable ReadToml(const std::filesystem::path& file, TomlTable::Expand expand = {});

// Returns the text as a TOML string, with its quotes.
std::string TomlString(const std::string& text);

}  // namespace raylift
