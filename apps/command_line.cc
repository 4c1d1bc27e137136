#include "apps/command_line.h"

#include <algorithm>
#include <cmath>

#include "base/json_text.h"
#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;
using std::filesystem::path;

std::string WithNames(std::string help, const std::vector<std::string>& names) {
  const size_t braces = help.find("{}");
  return braces == std::string::npos
             ? help
             : help.replace(braces, 2, fmt::format("{}", fmt::join(names, "|")));
}

Json EffectiveValue(const CLI::Option& option) {
  if (option.get_items_expected_max() == 0) {  // a flag
    return option.count() > 0 && option.as<bool>();
  }
  if (option.get_items_expected_max() > 1) {
    return option.count() > 0 ? option.reduced_results() : std::vector<std::string>{};
  }
  if (option.count() == 0 && option.get_default_str().empty()) {
    return nullptr;
  }
  const std::string type = option.get_type_name();
  if (type == "INT") return option.as<int64_t>();
  if (type == "UINT") return option.as<uint64_t>();
  if (type == "FLOAT") return option.as<double>();
  return option.as<std::string>();
}

std::string ShellQuoted(const std::string& text) {
  constexpr std::string_view kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=./,:@%";
  if (!text.empty() && text.find_first_not_of(kPlain) == std::string::npos) return text;
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

// Returns the names that AddedOption::Names() kept; empty where it was not called.
std::string KeptNames(CLI::Option& option) {
  try {
    return option.get_validator(0)->get_name();
  } catch (const CLI::OptionNotFound&) {  // no validator
    return {};
  }
}

std::string WholeNumberError(std::string& text, bool is_unsigned) {
  if (const auto number = ParseUint(text)) {
    text = std::to_string(*number);
  } else if (const auto signed_number = ParseInt(text); signed_number && !is_unsigned) {
    text = std::to_string(*signed_number);
  } else {
    return fmt::format("expected a whole number{}, found \"{}\"",
                       is_unsigned ? " of at least 0" : "", text);
  }
  return {};
}

}  // namespace

const AddedOption& AddedOption::Required(bool required) const {
  option_->required(required);
  return *this;
}
const AddedOption& AddedOption::OnePerUse() const {
  option_->allow_extra_args(false);
  return *this;
}
const AddedOption& AddedOption::Commas() const {
  option_->delimiter(',');
  return *this;
}
const AddedOption& AddedOption::Default(const std::string& text) const {
  option_->default_str(text);
  return *this;
}
const AddedOption& AddedOption::Type(const std::string& name) const {
  option_->type_name(name);
  return *this;
}
const AddedOption& AddedOption::Names(const std::vector<std::string>& names) const {
  // This validator refuses nothing; it keeps the names with the option.
  option_->check(CLI::Validator("").name(fmt::format("{}", fmt::join(names, "|"))));
  return *this;
}
const AddedOption& AddedOption::NotConfigurable() const {
  option_->configurable(false);
  return *this;
}

AddedOption OptionGroup::Flag(const std::string& name, bool& value, const std::string& help) const {
  return AddedOption(command_.add_flag(name, value, help)->group(name_));
}

AddedOption OptionGroup::Print(const std::string& name, std::string (*text)(),
                               const std::string& help) const {
  const auto print = [text] {
    fmt::print("{}", text());
    throw CLI::Success();
  };
  return AddedOption(command_.add_flag_callback(name, print, help)->group(name_));
}

template <OptionValue Value>
AddedOption OptionGroup::Add(const std::string& name, Value& value, const std::string& help) const {
  CLI::Option* option = command_.add_option(name, value, help)->group(name_);
  if constexpr (kIsOneOf<Value, int, uint64_t, double, std::string, path>) {
    option->capture_default_str();
  } else if constexpr (std::is_same_v<Value, std::vector<double>>) {
    if (!value.empty()) option->capture_default_str();
  }
  return AddedOption(option);
}
template AddedOption OptionGroup::Add(const std::string&, int&, const std::string&) const;
template AddedOption OptionGroup::Add(const std::string&, uint64_t&, const std::string&) const;
template AddedOption OptionGroup::Add(const std::string&, double&, const std::string&) const;
template AddedOption OptionGroup::Add(const std::string&, std::string&, const std::string&) const;
template AddedOption OptionGroup::Add(const std::string&, path&, const std::string&) const;
template AddedOption OptionGroup::Add(const std::string&, std::optional<int>&,
                                      const std::string&) const;
template AddedOption OptionGroup::Add(const std::string&, std::optional<double>&,
                                      const std::string&) const;
template AddedOption OptionGroup::Add(const std::string&, std::vector<std::string>&,
                                      const std::string&) const;
template AddedOption OptionGroup::Add(const std::string&, std::vector<path>&,
                                      const std::string&) const;
template AddedOption OptionGroup::Add(const std::string&, std::vector<double>&,
                                      const std::string&) const;

AddedOption OptionGroup::Add(const std::string& name, const NamedValue& value,
                             const std::string& help) const {
  return AddText(
             name, WithNames(help, value.names()),
             [name, value](const std::string& text) {
               value.Set(ParseName(name, text, value.names()));
             },
             value.name())
      .Names(value.names());
}

void OptionGroup::Add(std::span<const Field> fields) const {
  for (const Field& field : fields) {
    std::string name = fmt::format("--{}", field.name);
    std::replace(name.begin(), name.end(), '_', '-');
    std::visit(
        [&](const auto& value) {
          using Value = std::decay_t<decltype(value)>;
          if constexpr (std::is_same_v<Value, NamedValue>) {
            Add(name, value, field.help);
          } else if constexpr (std::is_same_v<Value, bool*>) {
            Flag(name, *value, field.help);
          } else {
            Add(name, *value, field.help);
          }
        },
        field.value);
  }
}

AddedOption OptionGroup::AddText(const std::string& name, const std::string& help,
                                 const std::function<void(const std::string& text)>& take,
                                 const std::string& default_text) const {
  return AddedOption(command_.add_option_function<std::string>(name, take, help)
                         ->default_str(default_text)
                         ->group(name_));
}

AddedOption OptionGroup::AddNameList(const std::string& name, const std::vector<std::string>& names,
                                     const std::function<void(std::span<const size_t>)>& take,
                                     const std::vector<std::string>& defaults,
                                     const std::string& help) const {
  const auto take_text = [=](const std::string& text) {
    std::vector<size_t> indices;
    for (const std::string_view part : SplitBy(text, ',')) {
      const auto known = std::find(names.begin(), names.end(), part);
      if (known == names.end()) {
        throw OptionError(
            name, text,
            fmt::format("expected a list of {}{}", fmt::join(names, "|"), DidYouMean(part, names)));
      }
      indices.push_back(static_cast<size_t>(known - names.begin()));
    }
    take(indices);
  };
  return AddText(name, WithNames(help, names), take_text,
                 fmt::format("{}", fmt::join(defaults, ",")));
}

size_t ParseName(std::string_view option, std::string_view text,
                 const std::vector<std::string>& names) {
  const auto known = std::find(names.begin(), names.end(), text);
  if (known != names.end()) return static_cast<size_t>(known - names.begin());
  throw OptionError(option, text,
                    fmt::format("expected {}{}", fmt::join(names, "|"), DidYouMean(text, names)));
}

double ParsePositive(std::string_view option, const std::string& text) {
  const auto value = ParseDouble(text);
  if (!value || !(*value > 0) || !std::isfinite(*value)) {
    throw OptionError(option, text, "must be a positive number");
  }
  return *value;
}

CLI::App& AddCommand(CLI::App& program, const std::string& name, const std::string& what) {
  return *program.add_subcommand(name, what);
}

void AddAlias(CLI::App& command, const std::string& name) { command.alias(name); }

void SetFooter(CLI::App& command, const std::string& text) { command.footer(text); }

std::string NameOf(const CLI::App& command) { return command.get_name(); }

bool IsSibling(const CLI::App& command, const std::string& name) {
  const auto found = command.get_parent()->get_subcommands(
      [&name](const CLI::App* other) { return other->get_name() == name; });
  return !found.empty();
}

std::optional<OptionFacts> FindOption(const CLI::App& command, const std::string& option) {
  const CLI::Option* found = command.get_option_no_throw(option);
  if (found == nullptr) return std::nullopt;
  return OptionFacts{.name = found->get_name(),
                     .is_positional = found->get_positional(),
                     .is_configurable = found->get_configurable(),
                     .is_given = found->count() > 0};
}

bool IsGiven(const CLI::App& command, const std::string& option) {
  const auto found = FindOption(command, option);
  return found && found->is_given;
}

std::string GivenText(const CLI::App& command, const std::string& option) {
  return IsGiven(command, option) ? command.get_option(option)->as<std::string>() : std::string();
}

void Translate(CLI::App& command, const std::string& option,
               std::function<std::string(const std::string&)> translation) {
  CLI::Option* found = command.get_option_no_throw(option);
  if (found == nullptr) return;
  found->transform(CLI::Validator(
      [translation = std::move(translation)](std::string& text) -> std::string {
        text = translation(text);
        return {};
      },
      ""));
}

void CheckNumbers(CLI::App& command) {
  for (CLI::Option* option : command.get_options()) {
    const std::string type = option->get_type_name();
    if (type == "INT" || type == "UINT") {
      option->transform(CLI::Validator(
          [is_unsigned = type == "UINT"](std::string& text) {
            return WholeNumberError(text, is_unsigned);
          },
          ""));
    } else if (type == "FLOAT") {
      option->check([](const std::string& text) -> std::string {
        const auto number = ParseDouble(text);
        if (number && std::isfinite(*number)) return {};
        return fmt::format("expected a number, found \"{}\"", text);
      });
    }
  }
}

std::map<std::string, std::string> KindsOfOptions(CLI::App& command) {
  std::map<std::string, std::string> kinds;
  for (CLI::Option* option : command.get_options()) {
    if (option->get_positional()) continue;
    std::string kind = KeptNames(*option);
    if (kind.empty()) kind = option->get_type_name();
    if (option->get_items_expected_max() == 0) kind = "FLAG";
    if (option->get_items_expected_max() > 1) kind += " ...";
    kinds[option->get_single_name()] = kind;
  }
  return kinds;
}

std::string CommandLine(const CLI::App& command) {
  std::string line = "raylift " + command.get_name();
  for (const CLI::Option* option : command.get_options()) {
    if (option->count() == 0 || !option->get_configurable()) continue;
    const std::string name = option->get_positional() ? "" : " " + option->get_name();
    const bool is_flag = option->get_expected_min() == 0;
    if (is_flag) line += name;
    for (const std::string& value : option->results()) {
      if (!is_flag) line += name + " " + ShellQuoted(value);
    }
  }
  return line;
}

std::string EffectiveOptionsJson(const CLI::App& command) {
  Json options = Json::object();
  options["command"] = command.get_name();
  options["raylift_version"] = RAYLIFT_VERSION;
  for (const CLI::Option* option : command.get_options()) {
    if (option->get_configurable()) {
      options[option->get_single_name()] = EffectiveValue(*option);
    }
  }
  return JsonText(options, 2) + '\n';
}

}  // namespace raylift
