#include "io/text/toml_file.h"

#include <algorithm>
#include <set>
#include <utility>

#include "io/text/toml_node.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

std::string LineText(const TomlNode& node) { return fmt::format("line {}", node.line); }

}  // namespace

struct TomlTable::Impl {
  const TomlNode* Find(std::string_view key) const {
    const auto& entries = Entries();
    const auto found = entries.find(key);
    return found == entries.end() ? nullptr : &found->second;
  }

  const TomlNode::Table& Entries() const { return std::get<TomlNode::Table>(table->value); }

  const TomlNode* Read(std::string_view key) {
    read.emplace(key);
    return Find(key);
  }

  std::string PlaceOf(std::string_view key) const {
    return place.empty() ? std::string(key) : fmt::format("{}.{}", place, key);
  }

  TomlTable Part(std::string part_place, const TomlNode& part) const {
    return TomlTable(std::make_unique<Impl>(Impl{
        file, std::move(part_place), std::shared_ptr<const TomlNode>(table, &part), expand, {}}));
  }

  [[noreturn]] void Fail(std::string_view key, std::string_view message) const {
    const TomlNode* node = Find(key);
    if (node == nullptr) throw InputError(file, PlaceOf(key), message);
    throw InputError(file, fmt::format("{}: {}", LineText(*node), PlaceOf(key)), message);
  }

  std::string Expanded(std::string_view key, const std::string& text) const {
    if (!expand) return text;
    try {
      return expand(text);
    } catch (const InputError& error) {
      Fail(key, error.what());
    }
  }

  std::string ValueText(std::string_view key, const TomlNode& node) const {
    if (const auto* text = node.As<std::string>()) return Expanded(key, *text);
    if (const auto* integer = node.As<int64_t>()) return std::to_string(*integer);
    if (const auto* number = node.As<double>()) return FormatDouble(*number);
    if (const auto* boolean = node.As<bool>()) return *boolean ? "true" : "false";
    Fail(key, "expected a string, a number, a boolean or a list");
  }

  std::filesystem::path file;
  std::string place;  // "scenes.demo"; empty at the top
  std::shared_ptr<const TomlNode> table;
  Expand expand;
  std::set<std::string> read;
};

TomlTable::TomlTable(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
TomlTable::~TomlTable() = default;
TomlTable::TomlTable(TomlTable&&) noexcept = default;
TomlTable& TomlTable::operator=(TomlTable&&) noexcept = default;

bool TomlTable::Has(std::string_view key) const { return impl_->Find(key) != nullptr; }

bool TomlTable::IsTable(std::string_view key) const {
  const TomlNode* node = impl_->Find(key);
  return node != nullptr && node->As<TomlNode::Table>() != nullptr;
}

std::vector<std::string> TomlTable::Keys() const {
  std::vector<std::string> keys;
  for (const auto& [key, node] : impl_->Entries()) keys.push_back(key);
  return keys;
}

int TomlTable::LineOf(std::string_view key) const {
  const TomlNode* node = impl_->Find(key);
  return node == nullptr ? 0 : node->line;
}

std::optional<std::string> TomlTable::Text(std::string_view key) {
  const TomlNode* node = impl_->Read(key);
  if (node == nullptr) return std::nullopt;
  const auto* text = node->As<std::string>();
  if (text == nullptr) Fail(key, "expected a string");
  return impl_->Expanded(key, *text);
}

std::string TomlTable::RequiredText(std::string_view key) {
  auto text = Text(key);
  if (!text) Fail(key, "is missing");
  return *std::move(text);
}

std::optional<double> TomlTable::Number(std::string_view key) {
  const TomlNode* node = impl_->Read(key);
  if (node == nullptr) return std::nullopt;
  if (const auto* number = node->As<double>()) return *number;
  if (const auto* number = node->As<int64_t>()) return static_cast<double>(*number);
  Fail(key, "expected a number");
}

std::optional<bool> TomlTable::Boolean(std::string_view key) {
  const TomlNode* node = impl_->Read(key);
  if (node == nullptr) return std::nullopt;
  const auto* value = node->As<bool>();
  if (value == nullptr) Fail(key, "expected true or false");
  return *value;
}

std::optional<int64_t> TomlTable::Integer(std::string_view key) {
  const TomlNode* node = impl_->Read(key);
  if (node == nullptr) return std::nullopt;
  const auto* number = node->As<int64_t>();
  if (number == nullptr) Fail(key, "expected a whole number");
  return *number;
}

std::vector<std::string> TomlTable::Values(std::string_view key) {
  const TomlNode* node = impl_->Read(key);
  std::vector<std::string> values;
  if (node == nullptr) return values;
  if (const auto* array = node->As<TomlNode::Array>()) {
    for (const TomlNode& element : *array) values.push_back(impl_->ValueText(key, element));
    if (values.empty()) Fail(key, "must not be empty");
  } else {
    values.push_back(impl_->ValueText(key, *node));
  }
  return values;
}

std::optional<TomlTable> TomlTable::Table(std::string_view key) {
  const TomlNode* node = impl_->Read(key);
  if (node == nullptr) return std::nullopt;
  if (node->As<TomlNode::Table>() == nullptr) Fail(key, "expected a table");
  return impl_->Part(impl_->PlaceOf(key), *node);
}

std::vector<TomlTable> TomlTable::Tables(std::string_view key) {
  const TomlNode* node = impl_->Read(key);
  std::vector<TomlTable> tables;
  if (node == nullptr) return tables;
  const auto* array = node->As<TomlNode::Array>();
  if (array == nullptr) Fail(key, fmt::format("expected [[{}]] tables", key));
  for (const TomlNode& element : *array) {
    if (element.As<TomlNode::Table>() == nullptr) {
      Fail(key, fmt::format("expected [[{}]] tables", key));
    }
    tables.push_back(
        impl_->Part(fmt::format("{} {}", impl_->PlaceOf(key), tables.size() + 1), element));
  }
  return tables;
}

void TomlTable::TakeFields(std::span<const Field> fields, std::string_view prefix) {
  const auto take_integer = [this](std::string_view key, auto& value) {
    using Number = std::remove_reference_t<decltype(value)>;
    const int64_t number = *Integer(key);
    if (!std::in_range<Number>(number)) Fail(key, "is out of range");
    value = static_cast<Number>(number);
  };
  for (const Field& field : fields) {
    RAYLIFT_CHECK(field.name.starts_with(prefix));
    const std::string_view key = field.name.substr(prefix.size());
    if (!Has(key)) continue;
    if (auto* const* flag = std::get_if<bool*>(&field.value)) **flag = *Boolean(key);
    if (auto* const* number = std::get_if<int*>(&field.value)) take_integer(key, **number);
    if (auto* const* number = std::get_if<uint64_t*>(&field.value)) take_integer(key, **number);
    if (auto* const* number = std::get_if<double*>(&field.value)) **number = *Number(key);
    if (auto* const* number = std::get_if<std::optional<int>*>(&field.value)) {
      take_integer(key, (*number)->emplace());
    }
    if (auto* const* number = std::get_if<std::optional<double>*>(&field.value)) {
      **number = Number(key);
    }
    if (const auto* named = std::get_if<NamedValue>(&field.value)) {
      const std::string text = *Text(key);
      try {
        named->Set(text);
      } catch (const InputError& error) {
        Fail(key, error.what());
      }
    }
  }
}

void TomlTable::CheckFields(std::span<const Field> fields, std::string_view prefix) const {
  try {
    CheckRanges(fields);
  } catch (const OptionError& error) {
    Fail(error.name().substr(prefix.size()),
         fmt::format("{}, found {}", error.constraint(), error.value()));
  }
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
  const std::string line = LineText(*impl_->table);
  throw InputError(impl_->file,
                   impl_->place.empty() ? line : fmt::format("{}: {}", line, impl_->place),
                   message);
}

void TomlTable::FailWith(std::string_view key, std::string_view expected,
                         std::string_view found) const {
  Fail(key, fmt::format("expected {}, found \"{}\"", expected, found));
}

// Throws InputError: the libraries go as deep as a key has parts, and so would their stacks. Values
// have not so many dots without a comma, but for those that stand side by side.
static void RequireShortKeys(std::string_view text, const std::filesystem::path& file) {
  constexpr std::string_view kEnds = "=,{}[]\n";
  int line = 1, dots = 0;
  char before = '\n';
  for (const char letter : text) {
    if (letter == '\n') ++line;
    if (kEnds.find(letter) != kEnds.npos) dots = 0;
    if (letter == '.' && before != '.' && ++dots >= kDeepestToml) {
      throw InputError(file, fmt::format("line {}", line), "a key has too many parts");
    }
    before = letter;
  }
}

TomlTable ReadToml(const std::filesystem::path& file, TomlTable::Expand expand) {
  const std::string text = ReadFile(file);
  RequireShortKeys(text, file);
  auto table = std::make_shared<const TomlNode>(ParseToml(text, file));
  return TomlTable(std::make_unique<TomlTable::Impl>(
      TomlTable::Impl{file, "", std::move(table), std::move(expand), {}}));
}

std::string TomlString(const std::string& text) {
  const auto is_control = [](char letter) {
    return (letter >= 0 && letter < ' ') || letter == 127;
  };
  if (text.find('\'') == text.npos && std::ranges::none_of(text, is_control))
    return fmt::format("'{}'", text);
  std::string escaped;
  for (const char letter : text) {
    if (is_control(letter)) {
      escaped += fmt::format("\\u{:04x}", letter);
    } else {
      if (letter == '"' || letter == '\\') escaped += '\\';
      escaped += letter;
    }
  }
  return fmt::format("\"{}\"", escaped);
}

}  // namespace raylift
