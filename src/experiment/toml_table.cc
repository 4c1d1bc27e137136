#include "toml_table.h"

#include <utility>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {

std::shared_ptr<const toml::table> ParseTomlFile(const std::filesystem::path& file) {
  const std::string text = ReadFile(file);
  try {
    return std::make_shared<const toml::table>(toml::parse(text, file.string()));
  } catch (const toml::parse_error& error) {
    throw InputError(file, fmt::format("line {}", error.source().begin.line), error.description());
  }
}

TomlTable::TomlTable(std::filesystem::path file, std::string place,
                     std::shared_ptr<const toml::table> table, Expand expand)
    : file_(std::move(file)),
      place_(std::move(place)),
      table_(std::move(table)),
      expand_(std::move(expand)) {}

std::vector<std::string> TomlTable::Keys() const {
  std::vector<std::string> keys;
  for (const auto& [key, node] : *table_) keys.emplace_back(key.str());
  return keys;
}

bool TomlTable::IsTable(std::string_view key) const {
  const toml::node* node = table_->get(key);
  return node != nullptr && node->is_table();
}

int TomlTable::LineOf(std::string_view key) const {
  const toml::node* node = table_->get(key);
  return node == nullptr ? 0 : static_cast<int>(node->source().begin.line);
}

const toml::node* TomlTable::Find(std::string_view key) {
  read_.emplace(key);
  return table_->get(key);
}

std::optional<std::string> TomlTable::Text(std::string_view key) {
  const toml::node* node = Find(key);
  if (node == nullptr) return std::nullopt;
  const auto* text = node->as_string();
  if (text == nullptr) Fail(key, "expected a text");
  return Expanded(key, text->get());
}

std::string TomlTable::RequiredText(std::string_view key) {
  auto text = Text(key);
  if (!text) Fail(key, "is missing");
  return *std::move(text);
}

std::optional<double> TomlTable::Number(std::string_view key) {
  const toml::node* node = Find(key);
  if (node == nullptr) return std::nullopt;
  if (const auto* number = node->as_floating_point()) return number->get();
  if (const auto* number = node->as_integer()) return static_cast<double>(number->get());
  Fail(key, "expected a number");
}

std::optional<bool> TomlTable::Boolean(std::string_view key) {
  const toml::node* node = Find(key);
  if (node == nullptr) return std::nullopt;
  const auto* value = node->as_boolean();
  if (value == nullptr) Fail(key, "expected true or false");
  return value->get();
}

std::optional<int64_t> TomlTable::Integer(std::string_view key) {
  const toml::node* node = Find(key);
  if (node == nullptr) return std::nullopt;
  const auto* number = node->as_integer();
  if (number == nullptr) Fail(key, "expected a whole number");
  return number->get();
}

std::vector<std::string> TomlTable::Values(std::string_view key) {
  const toml::node* node = Find(key);
  std::vector<std::string> values;
  if (node == nullptr) return values;
  if (const toml::array* array = node->as_array()) {
    for (const toml::node& element : *array) values.push_back(ValueText(key, element));
    if (values.empty()) Fail(key, "must not be empty");
  } else {
    values.push_back(ValueText(key, *node));
  }
  return values;
}

std::optional<TomlTable> TomlTable::Table(std::string_view key) {
  const toml::node* node = Find(key);
  if (node == nullptr) return std::nullopt;
  const toml::table* table = node->as_table();
  if (table == nullptr) Fail(key, "expected a table");
  return TomlTable(file_, PlaceOf(key), {table_, table}, expand_);
}

std::vector<TomlTable> TomlTable::Tables(std::string_view key) {
  const toml::node* node = Find(key);
  std::vector<TomlTable> tables;
  if (node == nullptr) return tables;
  const toml::array* array = node->as_array();
  if (array == nullptr) Fail(key, fmt::format("expected [[{}]]", key));
  for (const toml::node& element : *array) {
    const toml::table* table = element.as_table();
    if (table == nullptr) Fail(key, fmt::format("expected [[{}]]", key));
    tables.push_back(TomlTable(file_, fmt::format("{} {}", PlaceOf(key), tables.size() + 1),
                               {table_, table}, expand_));
  }
  return tables;
}

void TomlTable::RequireAllRead() const {
  for (const std::string& key : Keys()) {
    if (!read_.contains(key)) Fail(key, "is no key that can stand here");
  }
}

void TomlTable::Fail(std::string_view key, std::string_view message) const {
  const toml::node* node = table_->get(key);
  const std::string line =
      node != nullptr ? fmt::format("line {}: ", node->source().begin.line) : std::string();
  throw InputError(file_, fmt::format("{}{}", line, PlaceOf(key)), message);
}

void TomlTable::FailWith(std::string_view key, std::string_view expected,
                         std::string_view found) const {
  Fail(key, fmt::format("expected {}, found \"{}\"", expected, found));
}

std::string TomlTable::Expanded(std::string_view key, const std::string& text) const {
  try {
    return expand_(text);
  } catch (const std::string& message) {
    Fail(key, message);
  }
}

std::string TomlTable::ValueText(std::string_view key, const toml::node& node) const {
  if (const auto* text = node.as_string()) return Expanded(key, text->get());
  if (const auto* integer = node.as_integer()) return std::to_string(integer->get());
  if (const auto* number = node.as_floating_point()) return FormatDouble(number->get());
  Fail(key, "expected texts or numbers");
}

std::string TomlTable::PlaceOf(std::string_view key) const {
  return place_.empty() ? std::string(key) : fmt::format("{}.{}", place_, key);
}

}  // namespace raylift
