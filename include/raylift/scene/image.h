// An 8-bit picture in memory.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace raylift {

// 8-bit, row-major, interleaved channels (1: gray, 3: red, green, blue).
struct Image {
  int width_px = 0;
  int height_px = 0;
  int channels = 0;
  std::vector<uint8_t> data;

  uint8_t* Pixel(int x, int y) {
    return data.data() + (static_cast<size_t>(y) * width_px + x) * channels;
  }
  const uint8_t* Pixel(int x, int y) const {
    return data.data() + (static_cast<size_t>(y) * width_px + x) * channels;
  }
};

// Of an RGB picture by ITU-R BT.601, as decoders make gray of color; a gray one as it is.
Image ToGray(const Image& image);

}  // namespace raylift
