// What a camera writes into its photographs beside the pixels: EXIF, a small TIFF file in a JPEG.

#pragma once

#include <istream>
#include <optional>

namespace raylift {

struct Exif {
  // 1: as stored; 2 to 8: viewers flip and turn it, from 5 on so that the sides change places.
  int orientation = 1;
  std::optional<double> focal_mm = std::nullopt;
  // The focal length on film of 36 mm x 24 mm with the same angle of view.
  std::optional<double> focal_35mm = std::nullopt;
  std::optional<double> pixels_per_mm = std::nullopt;  // on the sensor, along x

  bool SwapsSides() const { return orientation >= 5; }
};

// Returns what the header of a JPEG says; values that are missing or senseless are left out.
Exif ReadExif(std::istream& file);

}  // namespace raylift
