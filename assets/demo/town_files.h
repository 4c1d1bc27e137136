// Makes the town and writes what a survey, drones and phones have of it.

#pragma once

#include <cstdint>
#include <filesystem>

namespace raylift::demo {

// Takes so many photographs by drones, and as many by phones. Its README.txt, which is written,
// too, says what is there.
void MakeTown(const std::filesystem::path& folder, uint64_t seed, int photographs);

}  // namespace raylift::demo
