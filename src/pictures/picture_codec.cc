#include "pictures/picture_codec.h"

#include <stdexcept>

#include "pictures/codecs.h"
#include <fmt/format.h>
#include <webp/decode.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

Image DecodeWebp(std::string_view bytes) {
  const auto* data = reinterpret_cast<const uint8_t*>(bytes.data());
  int width = 0, height = 0;
  if (WebPGetInfo(data, bytes.size(), &width, &height) == 0) {
    throw std::runtime_error("its header is damaged");
  }
  Image image = BlankImage(width, height, 3);
  if (WebPDecodeRGBInto(data, bytes.size(), image.data.data(), image.data.size(), 3 * width) ==
      nullptr) {
    throw std::runtime_error("it is damaged or truncated");
  }
  return image;
}

Image ToRgb(const Image& image) {
  if (image.channels == 3) return image;
  Image rgb = BlankImage(image.width_px, image.height_px, 3);
  for (size_t i = 0; i < rgb.data.size(); ++i) rgb.data[i] = image.data[i / 3];
  return rgb;
}

Image DecodeByFormat(std::string_view bytes, ImageChannels channels) {
  if (bytes.starts_with("\xFF\xD8")) return DecodeJpeg(bytes, channels);
  if (bytes.starts_with("\x89PNG")) return DecodePng(bytes, channels);
  const Image image = bytes.starts_with("BM")     ? DecodeBmp(bytes)
                      : bytes.starts_with("RIFF") ? DecodeWebp(bytes)
                      : bytes.starts_with("P")    ? DecodePnm(bytes)
                                                  : DecodeTiff(bytes);
  return channels == ImageChannels::kGray ? ToGray(image) : ToRgb(image);
}

}  // namespace

Image DecodePicture(std::string_view bytes, ImageChannels channels) {
  if (const auto why = WhyNoPicture(bytes)) throw InputError(*why);
  try {
    return DecodeByFormat(bytes, channels);
  } catch (const std::runtime_error& error) {
    throw InputError(fmt::format("the image cannot be decoded: {}", error.what()));
  }
}

}  // namespace raylift
