// Grey PNG files of 16 bits, as fast as libpng makes them. Private to io.

#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "raylift/io/depth_file.h"

namespace raylift {

// compression: 0 .. 9, of deflate. Every row is stored as its difference from the row above, which
// for depth takes half of the time of choosing a filter for each row, at a few per cent of size.
std::string EncodePng16(const std::filesystem::path& path_for_messages, PlaneSize size,
                        std::span<const uint16_t> counts, int compression);

}  // namespace raylift
