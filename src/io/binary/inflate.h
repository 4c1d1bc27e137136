// gzip files, by zlib. Private to io.

#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace raylift {

bool IsGzip(std::string_view bytes);

// All members of the file, one after the other. InputError where it is damaged or truncated.
std::string InflateGzip(const std::filesystem::path& path_for_messages, std::string_view bytes);

}  // namespace raylift
