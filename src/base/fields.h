// Fields of options and of records. One table per struct, beside it, serves the command line,
// files, Python's keywords, checks and results, so that an option or a count is added in one line:
//
//   std::vector<Field> FieldsOf(ConsistencyThresholds& values) {
//     return {{"filter_min_views", values.min_views, "References that must agree", kAtLeastOne},
//             {"filter_min_ratio", values.min_ratio, "Share that must agree", kShare}};
//   }
//
// A name is the option's with underscores ("--filter-min-views"), and ends in the unit.

#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "raylift/base/enum_names.h"

namespace raylift {

template <NamedEnum Enum>
std::vector<std::string> NamesOf() {
  std::vector<std::string> names;
  for (const EnumName<Enum>& entry : kEnumNames<Enum>) names.emplace_back(entry.name);
  return names;
}

// A variable of any enum that has names. An optional one may be empty, which is written as `none`.
class NamedValue {
 public:
  template <NamedEnum Enum>
  NamedValue(Enum& value)  // NOLINT(google-explicit-constructor): stands for the variable
      : value_(&value),
        names_(NamesOf<Enum>()),
        get_([](const void* v) { return ToString(*static_cast<const Enum*>(v)); }),
        set_([](void* v, size_t i) { *static_cast<Enum*>(v) = kEnumNames<Enum>[i].value; }) {}
  template <NamedEnum Enum>
  NamedValue(std::optional<Enum>& value,  // NOLINT(google-explicit-constructor): as above
             std::string none = "")
      : value_(&value),
        names_(NamesOf<Enum>()),
        none_(std::move(none)),
        get_([](const void* v) {
          const auto& open = *static_cast<const std::optional<Enum>*>(v);
          return open ? ToString(*open) : std::string_view();
        }),
        set_([](void* v, size_t i) {
          auto& open = *static_cast<std::optional<Enum>*>(v);
          open =
              i < kEnumNames<Enum>.size() ? std::optional(kEnumNames<Enum>[i].value) : std::nullopt;
        }) {
    if (!none_.empty()) names_.push_back(none_);
  }

  const std::vector<std::string>& names() const { return names_; }
  std::string name() const {
    const std::string_view name = get_(value_);
    return name.empty() ? none_ : std::string(name);
  }
  // Takes the value of names()[index].
  void Set(size_t index) const { set_(value_, index); }
  // Takes the value of a name; throws InputError where it is none of them.
  void Set(std::string_view name) const;

 private:
  void* value_;
  std::vector<std::string> names_;
  std::string none_;
  std::string_view (*get_)(const void*);
  void (*set_)(void*, size_t);
};

// The range of finite numbers that a field may hold, and its text for messages.
struct Range {
  std::string says;
  double least = -std::numeric_limits<double>::infinity();
  double most = std::numeric_limits<double>::infinity();
  bool without_least = false;
  bool without_most = false;

  bool Contains(double value) const;
};
inline const Range kAnyNumber{.says = "must be finite"};
inline const Range kPositive{.says = "must be positive", .least = 0, .without_least = true};
inline const Range kNotNegative{.says = "must not be negative", .least = 0};
inline const Range kAtLeastZero{.says = "must be at least 0", .least = 0};
inline const Range kAtLeastOne{.says = "must be at least 1", .least = 1};
inline const Range kShare{.says = "must be between 0 and 1", .least = 0, .most = 1};

struct Field {
  // A pointer to the field's variable.
  using Value = std::variant<bool*, int*, uint64_t*, double*, std::optional<int>*,
                             std::optional<double>*, NamedValue>;

  Field(std::string_view field_name, bool& v, std::string field_help)
      : name(field_name), value(&v), help(std::move(field_help)) {}
  Field(std::string_view field_name, NamedValue v, std::string field_help)
      : name(field_name), value(std::move(v)), help(std::move(field_help)) {}
  template <typename Number>
  Field(std::string_view field_name, Number& v, std::string field_help = "",
        Range field_range = kAnyNumber) requires(!NamedEnum<Number>)
      : name(field_name), value(&v), help(std::move(field_help)), range(std::move(field_range)) {}

  std::string_view name;
  Value value;
  std::string help;
  Range range = kAnyNumber;
};

// Throws OptionError "name = value: says" for the first number out of its range.
void CheckRanges(std::span<const Field> fields);

// Returns the table of a struct that is only read.
template <typename Struct>
std::vector<Field> ConstFieldsOf(const Struct& values) {
  return FieldsOf(const_cast<Struct&>(values));  // NOLINT(cppcoreguidelines-pro-type-const-cast)
}

// Calls `take(name, value)` for each field of a record of counts or of numbers (Number: uint64_t,
// double), as JSON or a Python dictionary takes them.
template <typename Number, typename Take>
void ForEachNumber(std::span<const Field> fields, const Take& take) {
  for (const Field& field : fields) {
    take(std::string(field.name), *std::get<Number*>(field.value));
  }
}

}  // namespace raylift
