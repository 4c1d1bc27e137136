#include "raylift/scene/image.h"

#include "raylift/base/error.h"

namespace raylift {

Image ToGray(const Image& image) {
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

}  // namespace raylift
