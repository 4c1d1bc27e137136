// Checks of numbers that options hold: OptionError with the name, the value and the constraint.

#pragma once

#include <string_view>
#include <type_traits>

namespace raylift {

// T: int or double. What is not finite is refused.
template <typename T>
void RequireAtLeast(std::string_view name, T value, std::type_identity_t<T> least);

template <typename T>
void RequirePositive(std::string_view name, T value);

}  // namespace raylift
