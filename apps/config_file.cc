#include "config_file.h"

#include <map>

#include <fmt/format.h>

#include "raylift/io/toml_file.h"

namespace raylift {
namespace {

using std::filesystem::path;

class ConfigReader {
 public:
  explicit ConfigReader(const CLI::App& command) : command_(command) {}

  std::vector<std::string> Arguments(const path& file) {
    TomlTable top = ReadToml(file);
    for (const std::string& key : top.Keys()) {
      if (!top.IsTable(key) || !IsCommand(key)) Take(top, key);
    }
    if (const std::string name = command_.get_name(); top.IsTable(name)) {
      TomlTable table = *top.Table(name);
      for (const std::string& key : table.Keys()) Take(table, key);
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
  void Take(TomlTable& table, const std::string& key) {
    const std::string name = OptionName(table, key);  // first, for its message
    values_[name] = table.Values(key);
  }

  bool IsCommand(const std::string& name) const {
    const auto commands = command_.get_parent()->get_subcommands(
        [&name](const CLI::App* command) { return command->get_name() == name; });
    return !commands.empty();
  }

  std::string OptionName(const TomlTable& table, const std::string& key) const {
    for (const std::string& name : {"--" + key, key}) {
      const CLI::Option* option = command_.get_option_no_throw(name);
      if (option != nullptr && option->get_configurable() && option->get_name() == name) {
        return name;
      }
    }
    table.FailAtLineOf(key,
                       fmt::format("\"{}\" is no option of raylift {}", key, command_.get_name()));
  }

  const CLI::App& command_;
  std::map<std::string, std::vector<std::string>> values_;  // by the option's name
};

}  // namespace

std::vector<std::string> ConfigArguments(const path& file, const CLI::App& command) {
  return ConfigReader(command).Arguments(file);
}

}  // namespace raylift
