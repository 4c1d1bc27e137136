// Adds options to commands through plain functions: only command_line.cc and program.cc include
// CLI11, whose templates are slow to compile. An invalid value is an OptionError, which passes
// through CLI11: "--method = foo: expected p3p|...".

#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/fields.h"

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace raylift {

// Settings that few options need.
class AddedOption {
 public:
  explicit AddedOption(CLI::Option* option) : option_(option) {}

  const AddedOption& Required(bool required = true) const;
  const AddedOption& OnePerUse() const;  // each of several values is given with the option's name
  const AddedOption& Commas() const;     // values are separated by commas
  const AddedOption& Default(const std::string& text) const;  // for help and options.json
  const AddedOption& Type(const std::string& name) const;
  const AddedOption& Names(const std::vector<std::string>& names) const;  // for KindsOfOptions()
  const AddedOption& NotConfigurable() const;  // it is in no file and not in options.json

 private:
  CLI::Option* option_;
};

// The types of an option's value, besides enums (NamedValue).
template <typename T, typename... Types>
inline constexpr bool kIsOneOf = (std::is_same_v<T, Types> || ...);
template <typename T>
concept OptionValue = kIsOneOf<T, int, uint64_t, double, std::string, std::filesystem::path,
                               std::optional<int>, std::optional<double>, std::vector<std::string>,
                               std::vector<std::filesystem::path>, std::vector<double>>;

// Adds options to a group of the command's options. The variables outlive the command; their values
// are the defaults.
class OptionGroup {
 public:
  explicit OptionGroup(CLI::App& command, std::string name = "Options")
      : command_(command), name_(std::move(name)) {}

  AddedOption Flag(const std::string& name, bool& value, const std::string& help) const;
  // Adds a flag that prints the text and ends the program.
  AddedOption Print(const std::string& name, std::string (*text)(), const std::string& help) const;

  template <OptionValue Value>
  AddedOption Add(const std::string& name, Value& value, const std::string& help) const;
  // "{}" in the help stands for the list of names.
  AddedOption Add(const std::string& name, const NamedValue& value, const std::string& help) const;
  // Adds an option for each field of a table: its name is "--" and the field's, with dashes for
  // underscores.
  void Add(std::span<const Field> fields) const;

  // Calls `take` with the option's text.
  AddedOption AddText(const std::string& name, const std::string& help,
                      const std::function<void(const std::string& text)>& take,
                      const std::string& default_text = "") const;
  // Sets `value`, which may be optional, to what `parse` makes of the option's name and text.
  template <typename Value, typename Parse>
  AddedOption AddParsed(const std::string& name, Value& value, Parse parse, const std::string& help,
                        const std::string& default_text = "") const {
    return AddText(
        name, help, [name, &value, parse](const std::string& text) { value = parse(name, text); },
        default_text);
  }
  // Reads values of an enum, separated by commas.
  template <NamedEnum Enum>
  AddedOption AddList(const std::string& name, std::vector<Enum>& values,
                      const std::string& help) const {
    std::vector<std::string> defaults;
    for (const Enum value : values) defaults.emplace_back(ToString(value));
    const auto take = [&values](std::span<const size_t> indices) {
      values.clear();
      for (const size_t i : indices) values.push_back(kEnumNames<Enum>[i].value);
    };
    return AddNameList(name, NamesOf<Enum>(), take, defaults, help);
  }

 private:
  AddedOption AddNameList(const std::string& name, const std::vector<std::string>& names,
                          const std::function<void(std::span<const size_t>)>& take,
                          const std::vector<std::string>& defaults, const std::string& help) const;

  CLI::App& command_;
  std::string name_;
};

// Returns the index of the name; throws OptionError, which suggests the likeliest name, where it is
// none of them.
size_t ParseName(std::string_view option, std::string_view text,
                 const std::vector<std::string>& names);
template <NamedEnum Enum>
Enum ParseEnum(std::string_view option, std::string_view text) {
  return kEnumNames<Enum>[ParseName(option, text, NamesOf<Enum>())].value;
}
double ParsePositive(std::string_view option, const std::string& text);

// Returns "name: description" of each value, one per line.
template <NamedEnum Enum>
std::string Descriptions() {
  std::string lines;
  for (const EnumName<Enum>& entry : kEnumNames<Enum>) {
    if (!lines.empty()) lines += '\n';
    (lines += entry.name) += ": ";
    lines += entry.description;
  }
  return lines;
}

CLI::App& AddCommand(CLI::App& program, const std::string& name, const std::string& what);
void AddAlias(CLI::App& command, const std::string& name);
void SetFooter(CLI::App& command, const std::string& text);

std::string NameOf(const CLI::App& command);
// Returns whether the program has another command, or this one, of that name.
bool IsSibling(const CLI::App& command, const std::string& name);

// An option of a command that was parsed.
struct OptionFacts {
  std::string name;
  bool is_positional;
  bool is_configurable;  // it may stand in a file
  bool is_given;
};
std::optional<OptionFacts> FindOption(const CLI::App& command, const std::string& option);
bool IsGiven(const CLI::App& command, const std::string& option);
// Returns the text that the option was given, as on the command line; empty where it was not given.
std::string GivenText(const CLI::App& command, const std::string& option);

// Replaces the values of an option, where the command has it, by their translations. To be called
// before the command is parsed.
void Translate(CLI::App& command, const std::string& option,
               std::function<std::string(const std::string&)> translation);

// Makes options that are numbers take plain decimal ones only: CLI11 alone reads 010 as 8 and -1 as
// the largest unsigned number.
void CheckNumbers(CLI::App& command);

// Returns the kind of value that each option of a command takes, by its name without dashes:
// "FLAG", "INT", "UINT", "FLOAT", "TEXT" or, where it takes only names, these
// ("keep|merge|triangulate"); " ..." follows where it may be repeated.
std::map<std::string, std::string> KindsOfOptions(CLI::App& command);

// Returns "raylift COMMAND --option value ..." with all options that were given, also by files,
// quoted for a shell.
std::string CommandLine(const CLI::App& command);

// Returns the options of a command with the values in effect, as JSON, for `options.json`: numbers
// and booleans as such, null where an option has no value.
std::string EffectiveOptionsJson(const CLI::App& command);

}  // namespace raylift
