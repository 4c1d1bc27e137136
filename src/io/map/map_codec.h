// Encodes depth maps and features for packed maps.

#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

#include "raylift/scene/features.h"
#include "raylift/scene/image.h"

namespace raylift {

// Encodes depth in steps of its logarithm, 65535 of them between the least and the largest z of the
// map:
//
//   z = exp(a + (b - a) (code - 1) / 65534),   code 0: no surface.
//
// Codes are numbered by their rank among those that the map has (a sensor knows some thousand
// depths), predicted from their left and upper neighbors as in LOCO-I (Weinberger et al. 2000), and
// what remains is a picture in WebP without loss: red has the upper bytes, green the lower ones.
// Throws InputError where a side has more than 16383 pixels.
std::string EncodeDepth(const DepthMap& map);
// Throws InputError naming `file` and `name` where the bytes are damaged.
DepthMap DecodeDepth(const std::filesystem::path& file, const std::string& name,
                     std::string_view bytes);

// Encodes pixels and scores as hloc's files hold them (float32; with kCompact pixels in steps of a
// 65535th of the longer side, and no scores), and descriptors in `precision`.
std::string EncodeFeatures(const Features& features, DescriptorPrecision precision);
Features DecodeFeatures(const std::filesystem::path& file, const std::string& name,
                        std::string_view bytes);

// Compress bytes by zlib, and decompress them to this size; throw InputError where they are
// damaged.
std::string Deflated(std::string_view bytes);
std::string Inflated(const std::filesystem::path& file, const std::string& name,
                     std::string_view deflated, size_t size);

}  // namespace raylift
