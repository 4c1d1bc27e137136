// Gray PNG files of depth by libpng, as fast as it writes them. Private to the libraries.

#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/scene/plane_size.h"

namespace raylift {

// compression: 0 .. 9, of deflate. Every row is stored as its difference from the row above, which
// for depth takes half of the time of choosing a filter for each row, at a few per cent of size.
std::string EncodePng16(const std::filesystem::path& path_for_messages, PlaneSize size,
                        std::span<const uint16_t> counts, int compression);

// What a PNG file's header says. InputError where the bytes end in it.
struct PngHeader {
  uint32_t width_px = 0;
  uint32_t height_px = 0;
  int bits = 0;
  bool is_gray = false;  // one channel, without alpha and palette
};
PngHeader ReadPngHeader(const std::filesystem::path& path_for_messages, std::string_view bytes);

// The samples of a file whose header says gray and 8 or 16 bits, row by row. InputError where the
// file is damaged or truncated: every checksum and the end are looked at.
std::vector<float> DecodeGrayPng(const std::filesystem::path& path_for_messages,
                                 const PngHeader& header, std::string_view bytes);

}  // namespace raylift
