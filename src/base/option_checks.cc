#include "raylift/base/option_checks.h"

#include <cmath>
#include <string>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

std::string Text(int value) { return std::to_string(value); }
std::string Text(double value) { return FormatDouble(value); }

}  // namespace

template <typename T>
void RequireAtLeast(std::string_view name, T value, std::type_identity_t<T> least) {
  if (!(value >= least) || !std::isfinite(static_cast<double>(value))) {
    throw OptionError(name, Text(value), fmt::format("must be at least {}", Text(least)));
  }
}

template <typename T>
void RequirePositive(std::string_view name, T value) {
  if (!(value > 0) || !std::isfinite(static_cast<double>(value))) {
    throw OptionError(name, Text(value), "must be positive");
  }
}

template void RequireAtLeast(std::string_view, int, int);
template void RequireAtLeast(std::string_view, double, double);
template void RequirePositive(std::string_view, int);
template void RequirePositive(std::string_view, double);

}  // namespace raylift
