// The decoders of single formats, which throw std::runtime_error for what is damaged. Their callers
// have looked at the claimed size (scene/picture_header.h). Private to pictures.

#pragma once

#include <string_view>

#include "raylift/pictures/picture_codec.h"
#include "raylift/scene/image.h"

namespace raylift {

// A picture of this size whose pixels are to be filled in.
inline Image BlankImage(int width_px, int height_px, int channels) {
  Image image{width_px, height_px, channels, {}};
  image.data.resize(static_cast<size_t>(width_px) * static_cast<size_t>(height_px) *
                    static_cast<size_t>(channels));
  return image;
}

// These make gray by themselves, as the files' own library does.
Image DecodeJpeg(std::string_view bytes, ImageChannels channels);
Image DecodePng(std::string_view bytes, ImageChannels channels);

// Red, green and blue; PNM gray where the file is.
Image DecodeBmp(std::string_view bytes);
Image DecodePnm(std::string_view bytes);
Image DecodeTiff(std::string_view bytes);

}  // namespace raylift
