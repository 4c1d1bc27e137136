// The checksum of a file, to tell whether it is still as it was written.

#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace raylift {

// XXH3 with 64 bits, as `xxhsum -H3` writes it: 16 digits. None where the file cannot be read.
std::optional<std::string> FileHash(const std::filesystem::path& file);

}  // namespace raylift
