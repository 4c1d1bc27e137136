#include "base/fields.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {

bool Range::Contains(double value) const {
  return std::isfinite(value) && (without_least ? value > least : value >= least) &&
         (without_most ? value < most : value <= most);
}

void NamedValue::Set(std::string_view name) const {
  const auto found = std::find(names_.begin(), names_.end(), name);
  if (found == names_.end()) {
    throw InputError(fmt::format("expected {}, found \"{}\"", fmt::join(names_, "|"), name));
  }
  Set(static_cast<size_t>(found - names_.begin()));
}

void CheckRanges(std::span<const Field> fields) {
  for (const Field& field : fields) {
    const auto check = [&field](double number) {
      if (field.range.Contains(number)) return;
      throw OptionError(field.name, FormatDouble(number), field.range.says);
    };
    if (const auto* value = std::get_if<int*>(&field.value)) check(**value);
    if (const auto* value = std::get_if<double*>(&field.value)) check(**value);
    if (const auto* value = std::get_if<std::optional<int>*>(&field.value); value && **value) {
      check(***value);
    }
    if (const auto* value = std::get_if<std::optional<double>*>(&field.value); value && **value) {
      check(***value);
    }
  }
}

}  // namespace raylift
