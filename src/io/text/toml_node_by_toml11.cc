// Stands for toml_node.cc where there is no toml++ (Ubuntu 22.04).

#include <algorithm>
#include <charconv>
#include <new>
#include <sstream>
#include <string_view>

#include "io/text/toml_node.h"
#include <fmt/format.h>
#include <toml.hpp>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using Parsed = toml::basic_value<toml::discard_comments, std::map, std::vector>;

bool FitsInt64(std::string digits) {
  std::erase(digits, '_');
  const int base = digits.starts_with("0x")   ? 16
                   : digits.starts_with("0o") ? 8
                   : digits.starts_with("0b") ? 2
                                              : 10;
  const int prefix = base != 10 ? 2 : digits.starts_with('+') ? 1 : 0;
  int64_t value = 0;
  const auto end = digits.data() + digits.size();
  return std::from_chars(digits.data() + prefix, end, value, base).ec == std::errc();
}

// Returns an integer. toml11 silently replaces one that is too large by the largest that fits.
int64_t IntegerOf(const Parsed& parsed, std::string_view key, const std::filesystem::path& file) {
  const toml::source_location place = parsed.location();
  const std::string digits = place.line_str().substr(place.column() - 1, place.region());
  if (!FitsInt64(digits)) {
    throw InputError(file, fmt::format("line {}: {}", place.line(), key),
                     fmt::format("'{}' is not representable in 64 bits", digits));
  }
  return parsed.as_integer();
}

// Converts a node; the key is that of the innermost table that the node is in.
TomlNode NodeOf(const Parsed& parsed, std::string_view key, const std::filesystem::path& file,
                int depth) {
  TomlNode node;
  node.line = static_cast<int>(parsed.location().line());
  if (depth > kDeepestToml) {
    throw InputError(file, fmt::format("line {}", node.line), "is nested too deeply");
  }
  if (parsed.is_string()) node.value = parsed.as_string().str;
  if (parsed.is_integer()) node.value = IntegerOf(parsed, key, file);
  if (parsed.is_floating()) node.value = parsed.as_floating();
  if (parsed.is_boolean()) node.value = parsed.as_boolean();
  if (parsed.is_array()) {
    auto& elements = node.value.emplace<TomlNode::Array>();
    for (const Parsed& element : parsed.as_array())
      elements.push_back(NodeOf(element, key, file, depth + 1));
  }
  if (parsed.is_table()) {
    auto& entries = node.value.emplace<TomlNode::Table>();
    for (const auto& [name, entry] : parsed.as_table())
      entries.emplace(name, NodeOf(entry, name, file, depth + 1));
  }
  return node;
}

// Throws where a text is nested too deep: toml11 goes as deep as the text does, and so would its
// stack.
void CheckDepth(const std::string& text, const std::filesystem::path& file) {
  int depth = 0;
  for (const char letter : text) {
    if (letter == '[' || letter == '{') ++depth;
    if (letter == ']' || letter == '}') depth = std::max(0, depth - 1);
    if (depth > kDeepestToml) throw InputError(file, "its brackets are nested too deeply");
  }
}

// Returns the first of toml11's lines, "[error] toml::parse_table: message".
std::string_view FirstLine(std::string_view said) {
  said = said.substr(0, said.find('\n'));
  const size_t prefix = said.rfind(": ");
  const std::string_view message = prefix == said.npos ? said : said.substr(prefix + 2);
  return message.empty() ? "expected TOML, found something else" : message;
}

}  // namespace

TomlNode ParseToml(const std::string& text, const std::filesystem::path& file) {
  CheckDepth(text, file);
  std::istringstream stream(text);
  Parsed parsed;
  try {
    parsed = toml::parse<toml::discard_comments, std::map, std::vector>(stream, file.string());
  } catch (const toml::exception& error) {
    throw InputError(file, fmt::format("line {}", error.location().line()),
                     FirstLine(error.what()));
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throw InputError(file, fmt::format("expected TOML, found: {}", FirstLine(error.what())));
  }
  return NodeOf(parsed, "", file, 0);
}

}  // namespace raylift
