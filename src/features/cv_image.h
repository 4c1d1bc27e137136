// Converts pictures for OpenCV.

#pragma once

#include <opencv2/core.hpp>

#include "raylift/scene/image.h"

namespace raylift {

// Returns a matrix on the image's own pixels, which is only to be read and lives as long as it.
inline cv::Mat AsMat(const Image& image) {
  return {image.height_px, image.width_px, CV_8UC(image.channels),
          const_cast<uint8_t*>(image.data.data())};
}

}  // namespace raylift
