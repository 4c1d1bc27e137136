// Options that become typed values as they are parsed. What they cannot be is an OptionError, which
// passes through CLI11: "--method = foo: expected p3p|...".

#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include "raylift/base/enum_names.h"
#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {

// `take` gets the option's text. `default_text` is for the help and for options.json.
inline CLI::Option* AddTextOption(CLI::App& app, const std::string& name, const std::string& help,
                                  const std::function<void(const std::string& text)>& take,
                                  const std::string& default_text = "") {
  return app.add_option_function<std::string>(name, take, help)->default_str(default_text);
}

// A value, or an optional one, that `parse` makes of the option's name and text.
template <typename Value, typename Parse>
CLI::Option* AddParsedOption(CLI::App& app, const std::string& name, Value& value, Parse parse,
                             const std::string& help, const std::string& default_text = "") {
  return AddTextOption(
      app, name, help,
      [name, &value, parse](const std::string& text) { value = parse(name, text); }, default_text);
}

// "; did you mean NAME?" where the text is close to the name of a value, or to `none`.
template <NamedEnum Enum>
std::string DidYouMeanEnum(std::string_view text, const std::string& none = "") {
  std::vector<std::string> names;
  for (const EnumName<Enum>& entry : kEnumNames<Enum>) names.emplace_back(entry.name);
  if (!none.empty()) names.push_back(none);
  return DidYouMean(text, names);
}

// The value of that name. OptionError in the name of the option otherwise.
template <NamedEnum Enum>
Enum ParseEnum(std::string_view option, std::string_view text) {
  const auto value = FromName<Enum>(text);
  if (!value) {
    throw OptionError(option, text, "expected " + NameList<Enum>() + DidYouMeanEnum<Enum>(text));
  }
  return *value;
}

// "{}" in the help stands for the list of names.
inline std::string WithNames(std::string help, const std::string& names) {
  const size_t place = help.find("{}");
  return place == std::string::npos ? help : help.replace(place, 2, names);
}

template <NamedEnum Enum>
CLI::Option* AddEnumOption(CLI::App& app, const std::string& name, Enum& value,
                           const std::string& help) {
  return AddParsedOption(app, name, value, &ParseEnum<Enum>, WithNames(help, NameList<Enum>()),
                         std::string(ToString(value)));
}

// One that may stay open: the word `none`, if there is one, says so.
template <NamedEnum Enum>
CLI::Option* AddEnumOption(CLI::App& app, const std::string& name, std::optional<Enum>& value,
                           const std::string& help, const std::string& none = "") {
  const std::string names = NameList<Enum>() + (none.empty() ? "" : "|" + none);
  const auto parse = [none, names](std::string_view option, std::string_view text) {
    const auto known = FromName<Enum>(text);
    if (!known && (none.empty() || text != none)) {
      throw OptionError(option, text, "expected " + names + DidYouMeanEnum<Enum>(text, none));
    }
    return known;
  };
  return AddParsedOption(app, name, value, parse, WithNames(help, names),
                         value ? std::string(ToString(*value)) : none);
}

// Values separated by commas.
template <NamedEnum Enum>
CLI::Option* AddEnumListOption(CLI::App& app, const std::string& name, std::vector<Enum>& values,
                               const std::string& help) {
  std::string default_text;
  for (const Enum value : values) {
    if (!default_text.empty()) default_text += ',';
    default_text += ToString(value);
  }
  const auto parse = [](std::string_view option, std::string_view text) {
    std::vector<Enum> parsed;
    for (const std::string_view part : SplitBy(text, ',')) {
      const auto value = FromName<Enum>(part);
      if (!value) {
        throw OptionError(option, text,
                          "expected a list of " + NameList<Enum>() + DidYouMeanEnum<Enum>(part));
      }
      parsed.push_back(*value);
    }
    return parsed;
  };
  return AddParsedOption(app, name, values, parse, WithNames(help, NameList<Enum>()), default_text);
}

// "name: description" of each value, a line each.
template <NamedEnum Enum>
std::string Descriptions() {
  std::string lines;
  for (const EnumName<Enum>& entry : kEnumNames<Enum>) {
    if (!lines.empty()) lines += '\n';
    lines += entry.name;
    lines += ": ";
    lines += entry.description;
  }
  return lines;
}

}  // namespace raylift
