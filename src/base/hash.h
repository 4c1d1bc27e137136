// A fast 64-bit hash (XXH3) of large memory, to tell whether two meshes or jobs are the same. It is
// not meant for protection against intent.

#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "base/bytes.h"

namespace raylift {

// Returns the XXH3 hash.
uint64_t HashBytes64(std::string_view bytes, uint64_t seed = 0);

// Returns a hash that does not depend on the number of threads.
uint64_t HashLarge(std::string_view bytes, int threads);

std::string HexText(uint64_t hash);  // 16 digits

// Returns the file's XXH3 with 64 bits, as `xxhsum -H3` writes it: 16 digits; nullopt if it cannot
// be read.
std::optional<std::string> FileHash(const std::filesystem::path& file);

}  // namespace raylift
