#include "config_file.h"

#include <map>

#include <fmt/format.h>
#include <toml++/toml.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

class ConfigReader {
 public:
  ConfigReader(const path& file, const CLI::App& command) : file_(file), command_(command) {}

  std::vector<std::string> Arguments() {
    const toml::table document = Parse();
    Collect(document, /*top=*/true);
    if (const toml::table* table = document[command_.get_name()].as_table()) {
      Collect(*table, /*top=*/false);
    }
    // Positional arguments first: an option of several values would take them for its own.
    std::vector<std::string> positionals, options;
    for (const auto& [name, values] : values_) {
      const CLI::Option& option = *command_.get_option_no_throw(name);
      if (option.count() > 0) {
        continue;
      }
      for (const std::string& value : values) {
        if (option.get_positional()) {
          positionals.push_back(value);
        } else {
          options.push_back(fmt::format("{}={}", name, value));
        }
      }
    }
    positionals.insert(positionals.end(), options.begin(), options.end());
    return positionals;
  }

 private:
  toml::table Parse() const {
    const std::string text = ReadFile(file_);
    try {
      return toml::parse(text, file_.string());
    } catch (const toml::parse_error& error) {
      throw InputError(file_, Place(error.source()), error.description());
    }
  }

  void Collect(const toml::table& table, bool top) {
    for (const auto& [key, node] : table) {
      const std::string name(key.str());
      if (top && node.is_table() && IsCommand(name)) {
        continue;
      }
      const std::string option = OptionName(name, node);
      values_[option] = Values(name, node);
    }
  }

  bool IsCommand(const std::string& name) const {
    const auto commands = command_.get_parent()->get_subcommands(
        [&name](const CLI::App* command) { return command->get_name() == name; });
    return !commands.empty();
  }

  std::string OptionName(const std::string& key, const toml::node& node) const {
    for (const std::string& name : {"--" + key, key}) {
      const CLI::Option* option = command_.get_option_no_throw(name);
      if (option != nullptr && option->get_configurable() && option->get_name() == name) {
        return name;
      }
    }
    throw InputError(file_, Place(node.source()),
                     fmt::format("\"{}\" is no option of raylift {}", key, command_.get_name()));
  }

  std::vector<std::string> Values(const std::string& key, const toml::node& node) const {
    std::vector<std::string> values;
    if (const toml::array* array = node.as_array()) {
      for (const toml::node& element : *array) {
        values.push_back(Value(key, element));
      }
    } else {
      values.push_back(Value(key, node));
    }
    return values;
  }

  std::string Value(const std::string& key, const toml::node& node) const {
    if (const auto* text = node.as_string()) return text->get();
    if (const auto* integer = node.as_integer()) return std::to_string(integer->get());
    if (const auto* number = node.as_floating_point()) return FormatDouble(number->get());
    if (const auto* boolean = node.as_boolean()) return boolean->get() ? "true" : "false";
    throw InputError(file_, Place(node.source()),
                     fmt::format("{}: expected a string, a number, a boolean or a list", key));
  }

  static std::string Place(const toml::source_region& source) {
    return fmt::format("line {}", source.begin.line);
  }

  const path& file_;
  const CLI::App& command_;
  std::map<std::string, std::vector<std::string>> values_;  // by the option's name
};

}  // namespace

std::vector<std::string> ConfigArguments(const path& file, const CLI::App& command) {
  return ConfigReader(file, command).Arguments();
}

}  // namespace raylift
