// Stands for toml_node.cc where there is no toml++ (Ubuntu 22.04).

#include <algorithm>
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

TomlNode NodeOf(const Parsed& parsed, const std::filesystem::path& file, int depth) {
  TomlNode node;
  node.line = static_cast<int>(parsed.location().line());
  if (depth > kDeepestToml) {
    throw InputError(file, fmt::format("line {}", node.line), "is nested too deeply");
  }
  if (parsed.is_string()) node.value = parsed.as_string().str;
  if (parsed.is_integer()) node.value = parsed.as_integer();
  if (parsed.is_floating()) node.value = parsed.as_floating();
  if (parsed.is_boolean()) node.value = parsed.as_boolean();
  if (parsed.is_array()) {
    auto& elements = node.value.emplace<TomlNode::Array>();
    for (const Parsed& element : parsed.as_array())
      elements.push_back(NodeOf(element, file, depth + 1));
  }
  if (parsed.is_table()) {
    auto& entries = node.value.emplace<TomlNode::Table>();
    for (const auto& [key, entry] : parsed.as_table())
      entries.emplace(key, NodeOf(entry, file, depth + 1));
  }
  return node;
}

// toml11 goes as deep as the text does, and so would its stack.
void CheckDepth(const std::string& text, const std::filesystem::path& file) {
  int depth = 0;
  for (const char letter : text) {
    if (letter == '[' || letter == '{') ++depth;
    if (letter == ']' || letter == '}') depth = std::max(0, depth - 1);
    if (depth > kDeepestToml) throw InputError(file, "its brackets are nested too deeply");
  }
}

// The first of the lines that toml11 says, "[error] toml::parse_table: message".
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
  return NodeOf(parsed, file, 0);
}

}  // namespace raylift
