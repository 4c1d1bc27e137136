// Planes of numbers in TIFF files by libtiff. Private to the libraries.

#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/scene/plane_size.h"

namespace raylift {

enum class TiffSample { kUint8, kUint16, kInt16, kInt32, kFloat32, kFloat64 };

// The only channel of a file that holds such samples, row by row. std::runtime_error where it holds
// others, or is damaged or truncated.
std::vector<float> DecodeTiffPlane(std::string_view bytes, PlaneSize size, TiffSample sample);

// 32-bit floats without compression.
std::string EncodeTiffPlane(PlaneSize size, std::span<const float> values);

}  // namespace raylift
