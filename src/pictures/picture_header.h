// The first bytes of a picture's file, looked at before a decoder gets them.

#pragma once

#include <istream>
#include <optional>
#include <string>
#include <string_view>

#include "raylift/scene/image.h"

namespace raylift {

// Returns the size of a PNG, JPEG, TIFF, BMP, WebP or PNM; nullopt if the header is damaged or of
// another format.
std::optional<PlaneSize> PictureSizeFromHeader(std::istream& file);

// Returns what is wrong with the bytes of a picture, as far as its header tells: they are of none
// of the formats that photographs and textures come in (PNG, JPEG, TIFF, BMP, WebP, PNM), or they
// claim more pixels than so many bytes can hold.
std::optional<std::string> WhyNoPicture(std::string_view bytes);

}  // namespace raylift
