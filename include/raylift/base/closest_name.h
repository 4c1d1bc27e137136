// What a mistyped name most likely stands for.

#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace raylift {

// The fewest letters to change, add, leave out or swap with their neighbor that make `b` of `a`.
size_t EditDistance(std::string_view a, std::string_view b);

// The one of `names` with the fewest such mistakes, the first of several; none where they are more
// than a third of its letters.
std::optional<std::string> ClosestName(std::string_view typed, std::span<const std::string> names);

// "; did you mean NAME?", or nothing.
std::string DidYouMean(std::string_view typed, std::span<const std::string> names);

}  // namespace raylift
