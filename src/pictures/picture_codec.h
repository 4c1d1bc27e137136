// Photographs and textures from the bytes of their files, and back, by the libraries of the
// formats: libjpeg, libpng, libtiff and libwebp; BMP and PNM are simple enough without one.

#pragma once

#include <string>
#include <string_view>

#include "raylift/scene/image.h"

namespace raylift {

// PNG, JPEG, TIFF, BMP, WebP or PNM. Pixels stay where they are stored, as the camera's intrinsics
// mean them: orientation tags are ignored. Transparency is left out, 16-bit samples keep their
// upper half. InputError, which names no file, where the bytes are none of these or damaged.
Image DecodePicture(std::string_view bytes, ImageChannels channels);

// Encode gray and RGB pictures; PNG takes four channels, too: RGB and opacity. quality: 0 to 100.
std::string EncodeJpeg(const Image& image, int quality);
std::string EncodePng(const Image& image);

}  // namespace raylift
