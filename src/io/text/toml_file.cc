#include "raylift/io/toml_file.h"

#include <set>
#include <sstream>
#include <utility>

#include <fmt/format.h>
#include <toml++/toml.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

std::string LineText(const toml::source_region& source) {
  return fmt::format("line {}", source.begin.line);
}

}  // namespace

struct TomlTable::Impl {
  const toml::node* Find(std::string_view key) const { return table->get(key); }

  const toml::node* Read(std::string_view key) {
    read.emplace(key);
    return Find(key);
  }

  std::string PlaceOf(std::string_view key) const {
    return place.empty() ? std::string(key) : fmt::format("{}.{}", place, key);
  }

  TomlTable Part(std::string part_place, const toml::table& part) const {
    return TomlTable(std::make_unique<Impl>(Impl{file,
                                                 std::move(part_place),
                                                 std::shared_ptr<const toml::table>(table, &part),
                                                 expand,
                                                 {}}));
  }

  [[noreturn]] void Fail(std::string_view key, std::string_view message) const {
    const toml::node* node = Find(key);
    if (node == nullptr) throw InputError(file, PlaceOf(key), message);
    throw InputError(file, fmt::format("{}: {}", LineText(node->source()), PlaceOf(key)), message);
  }

  std::string Expanded(std::string_view key, const std::string& text) const {
    if (!expand) return text;
    try {
      return expand(text);
    } catch (const InputError& error) {
      Fail(key, error.what());
    }
  }

  std::string ValueText(std::string_view key, const toml::node& node) const {
    if (const auto* text = node.as_string()) return Expanded(key, text->get());
    if (const auto* integer = node.as_integer()) return std::to_string(integer->get());
    if (const auto* number = node.as_floating_point()) return FormatDouble(number->get());
    if (const auto* boolean = node.as_boolean()) return boolean->get() ? "true" : "false";
    Fail(key, "expected a string, a number, a boolean or a list");
  }

  std::filesystem::path file;
  std::string place;  // "scenes.demo"; empty at the top
  std::shared_ptr<const toml::table> table;
  Expand expand;
  std::set<std::string> read;
};

TomlTable::TomlTable(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
TomlTable::~TomlTable() = default;
TomlTable::TomlTable(TomlTable&&) noexcept = default;
TomlTable& TomlTable::operator=(TomlTable&&) noexcept = default;

bool TomlTable::Has(std::string_view key) const { return impl_->Find(key) != nullptr; }

bool TomlTable::IsTable(std::string_view key) const {
  const toml::node* node = impl_->Find(key);
  return node != nullptr && node->is_table();
}

std::vector<std::string> TomlTable::Keys() const {
  std::vector<std::string> keys;
  for (const auto& [key, node] : *impl_->table) keys.emplace_back(key.str());
  return keys;
}

int TomlTable::LineOf(std::string_view key) const {
  const toml::node* node = impl_->Find(key);
  return node == nullptr ? 0 : static_cast<int>(node->source().begin.line);
}

std::optional<std::string> TomlTable::Text(std::string_view key) {
  const toml::node* node = impl_->Read(key);
  if (node == nullptr) return std::nullopt;
  const auto* text = node->as_string();
  if (text == nullptr) Fail(key, "expected a string");
  return impl_->Expanded(key, text->get());
}

std::string TomlTable::RequiredText(std::string_view key) {
  auto text = Text(key);
  if (!text) Fail(key, "is missing");
  return *std::move(text);
}

std::optional<double> TomlTable::Number(std::string_view key) {
  const toml::node* node = impl_->Read(key);
  if (node == nullptr) return std::nullopt;
  if (const auto* number = node->as_floating_point()) return number->get();
  if (const auto* number = node->as_integer()) return static_cast<double>(number->get());
  Fail(key, "expected a number");
}

std::optional<bool> TomlTable::Boolean(std::string_view key) {
  const toml::node* node = impl_->Read(key);
  if (node == nullptr) return std::nullopt;
  const auto* value = node->as_boolean();
  if (value == nullptr) Fail(key, "expected true or false");
  return value->get();
}

std::optional<int64_t> TomlTable::Integer(std::string_view key) {
  const toml::node* node = impl_->Read(key);
  if (node == nullptr) return std::nullopt;
  const auto* number = node->as_integer();
  if (number == nullptr) Fail(key, "expected a whole number");
  return number->get();
}

std::vector<std::string> TomlTable::Values(std::string_view key) {
  const toml::node* node = impl_->Read(key);
  std::vector<std::string> values;
  if (node == nullptr) return values;
  if (const toml::array* array = node->as_array()) {
    for (const toml::node& element : *array) values.push_back(impl_->ValueText(key, element));
    if (values.empty()) Fail(key, "must not be empty");
  } else {
    values.push_back(impl_->ValueText(key, *node));
  }
  return values;
}

std::optional<TomlTable> TomlTable::Table(std::string_view key) {
  const toml::node* node = impl_->Read(key);
  if (node == nullptr) return std::nullopt;
  const toml::table* table = node->as_table();
  if (table == nullptr) Fail(key, "expected a table");
  return impl_->Part(impl_->PlaceOf(key), *table);
}

std::vector<TomlTable> TomlTable::Tables(std::string_view key) {
  const toml::node* node = impl_->Read(key);
  std::vector<TomlTable> tables;
  if (node == nullptr) return tables;
  const toml::array* array = node->as_array();
  if (array == nullptr) Fail(key, fmt::format("expected [[{}]] tables", key));
  for (const toml::node& element : *array) {
    const toml::table* table = element.as_table();
    if (table == nullptr) Fail(key, fmt::format("expected [[{}]] tables", key));
    tables.push_back(
        impl_->Part(fmt::format("{} {}", impl_->PlaceOf(key), tables.size() + 1), *table));
  }
  return tables;
}

std::vector<std::string> TomlTable::UnreadKeys() const {
  std::vector<std::string> keys = Keys();
  std::erase_if(keys, [this](const std::string& key) { return impl_->read.contains(key); });
  return keys;
}

void TomlTable::RequireAllRead() const {
  for (const std::string& key : UnreadKeys()) Fail(key, "is no key that can stand here");
}

void TomlTable::Fail(std::string_view key, std::string_view message) const {
  impl_->Fail(key, message);
}

void TomlTable::FailAtLineOf(std::string_view key, std::string_view message) const {
  throw InputError(impl_->file, fmt::format("line {}", LineOf(key)), message);
}

void TomlTable::FailHere(std::string_view message) const {
  const std::string line = LineText(impl_->table->source());
  throw InputError(impl_->file,
                   impl_->place.empty() ? line : fmt::format("{}: {}", line, impl_->place),
                   message);
}

void TomlTable::FailWith(std::string_view key, std::string_view expected,
                         std::string_view found) const {
  Fail(key, fmt::format("expected {}, found \"{}\"", expected, found));
}

TomlTable ReadToml(const std::filesystem::path& file, TomlTable::Expand expand) {
  const std::string text = ReadFile(file);
  try {
    auto table = std::make_shared<const toml::table>(toml::parse(text, file.string()));
    return TomlTable(std::make_unique<TomlTable::Impl>(
        TomlTable::Impl{file, "", std::move(table), std::move(expand), {}}));
  } catch (const toml::parse_error& error) {
    throw InputError(file, LineText(error.source()), error.description());
  }
}

std::string TomlString(const std::string& text) {
  std::ostringstream stream;
  stream << toml::value<std::string>(text);
  return stream.str();
}

}  // namespace raylift
