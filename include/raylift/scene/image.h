// Pictures and depth maps in memory.

#pragma once

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "raylift/base/error.h"

namespace raylift {

struct PlaneSize {
  int width_px = 0;
  int height_px = 0;
  bool operator==(const PlaneSize&) const = default;
};

enum class ImageChannels { kGray, kRgb };

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

// Returns the luma of an RGB picture by ITU-R BT.601, as decoders make gray of color; a gray
// picture as it is.
inline Image ToGray(const Image& image) {
  if (image.channels == 1) return image;
  RAYLIFT_CHECK_EQ(image.channels, 3);
  Image gray{image.width_px, image.height_px, 1, {}};
  gray.data.resize(static_cast<size_t>(image.width_px) * static_cast<size_t>(image.height_px));
  for (size_t i = 0; i < gray.data.size(); ++i) {
    const uint8_t* color = image.data.data() + 3 * i;
    gray.data[i] =
        static_cast<uint8_t>((299 * color[0] + 587 * color[1] + 114 * color[2] + 500) / 1000);
  }
  return gray;
}

// z along the optical axis (in a panorama, which has no axis, the distance), row-major, in scene
// units; 0 = no surface.
struct DepthMap {
  int width_px = 0;
  int height_px = 0;
  std::vector<float> z;

  float At(int x, int y) const { return z[static_cast<size_t>(y) * width_px + x]; }
};

// Returns the nearest integer in 0 .. 255, halves upwards; 0 for NaN.
template <std::floating_point T>
uint8_t NearestByte(T value) {
  if (!(value > 0)) return 0;
  const T raised = std::min(value, T{255}) + T{0.5};
  return static_cast<uint8_t>(raised);  // not negative, hence cut off downwards
}

}  // namespace raylift
