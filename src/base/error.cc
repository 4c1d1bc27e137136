#include "raylift/base/error.h"

#include <fmt/format.h>

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
}  // namespace raylift
