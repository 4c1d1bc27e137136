// What readers of files do with names and words that others wrote. Private to renderers.

#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace raylift {

std::string Lower(std::string_view text);
std::string LowerExtension(const std::filesystem::path& path);

// A word for a message: its beginning, in printable ASCII.
std::string Shown(std::string_view token);

}  // namespace raylift
