#include "raylift/base/error.h"

#include <cmath>

#include <fmt/format.h>

#include "raylift/base/text.h"

namespace raylift {

InputError::InputError(const std::string& message) : std::runtime_error(message) {}

InputError::InputError(const std::filesystem::path& file, std::string_view message)
    : std::runtime_error(fmt::format("{}: {}", file.string(), message)) {}

InputError::InputError(const std::filesystem::path& file, std::string_view place,
                       std::string_view message)
    : std::runtime_error(fmt::format("{}: {}: {}", file.string(), place, message)) {}

OptionError::OptionError(const std::string& message) : std::runtime_error(message) {}

OptionError::OptionError(std::string_view name, std::string_view value, std::string_view constraint)
    : std::runtime_error(fmt::format("{} = {}: {}", name, value, constraint)),
      name_(name),
      value_(value),
      constraint_(constraint) {}

namespace internal {

void CheckFailed(const char* file, int line, const char* condition, const std::string& detail) {
  throw std::logic_error(fmt::format("{}:{}: check failed: {}{}{}", file, line, condition,
                                     detail.empty() ? "" : ": ", detail));
}

}  // namespace internal

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
