// Decodes photographs and textures from the bytes of their files, and encodes them, by the
// libraries of the formats: libjpeg, libpng, libtiff and libwebp; BMP and PNM are simple enough
// without one.

#pragma once

#include <istream>
#include <optional>
#include <string>
#include <string_view>

#include "raylift/scene/image.h"

namespace raylift {

// Decodes PNG, JPEG, TIFF, BMP, WebP or PNM. Pixels stay where they are stored, as the camera's
// intrinsics mean them: orientation tags are ignored. Transparency is left out, 16-bit samples keep
// their upper half. Throws InputError, which names no file, where the bytes are none of these or
// damaged.
Image DecodePicture(std::string_view bytes, ImageChannels channels);

// Encode gray and RGB pictures; PNG takes four channels, too: RGB and opacity. quality: 0 to 100.
std::string EncodeJpeg(const Image& image, int quality);
std::string EncodePng(const Image& image);

// Returns the size of a PNG, JPEG, TIFF, BMP, WebP or PNM; nullopt if the header is damaged or of
// another format.
std::optional<PlaneSize> PictureSizeFromHeader(std::istream& file);

// Returns what is wrong with the bytes of a picture, as far as its header tells: they are of none
// of the formats that photographs and textures come in (PNG, JPEG, TIFF, BMP, WebP, PNM), or they
// claim more pixels than so many bytes can hold.
std::optional<std::string> WhyNoPicture(std::string_view bytes);

}  // namespace raylift
