// GeoTIFF files in a projected system, north up, that say where the corner of their first pixel is.

#pragma once

#include <filesystem>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/image.h"

namespace raylift::demo {

struct RasterPlace {
  uint16_t epsg;
  Eigen::Vector2d upper_left;
  double cell_m;
};

// Heights, row by row from the north; NaN where there is none.
void WriteHeights(const std::filesystem::path& path, const RasterPlace& place, int width,
                  const std::vector<float>& heights);
void WriteOrthophoto(const std::filesystem::path& path, const RasterPlace& place,
                     const Image& image);

}  // namespace raylift::demo
