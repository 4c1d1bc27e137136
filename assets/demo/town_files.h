// Makes the town and writes what a survey, drones and phones have of it.

#pragma once

#include <cstdint>
#include <filesystem>

namespace raylift::demo {

// Its README.txt, which is written, too, says what is there.
void MakeTown(const std::filesystem::path& folder, uint64_t seed);

}  // namespace raylift::demo
