#include "surfaces/texture.h"

#include <algorithm>
#include <cmath>

namespace raylift {
namespace {

// Returns the means of 2 x 2 texels; an odd last row or column is left out.
Image Halved(const Image& image) {
  Image half{std::max(1, image.width_px / 2), std::max(1, image.height_px / 2), 3, {}};
  half.data.resize(static_cast<size_t>(half.width_px) * static_cast<size_t>(half.height_px) * 3);
  for (int y = 0; y < half.height_px; ++y) {
    const int y0 = 2 * y;
    const int y1 = std::min(y0 + 1, image.height_px - 1);
    for (int x = 0; x < half.width_px; ++x) {
      const int x0 = 2 * x;
      const int x1 = std::min(x0 + 1, image.width_px - 1);
      for (int c = 0; c < 3; ++c) {
        const int sum = image.Pixel(x0, y0)[c] + image.Pixel(x1, y0)[c] + image.Pixel(x0, y1)[c] +
                        image.Pixel(x1, y1)[c];
        half.Pixel(x, y)[c] = static_cast<uint8_t>((sum + 2) / 4);
      }
    }
  }
  return half;
}

Eigen::Vector3f Texel(const Image& image, int x, int y) {
  const uint8_t* rgb = image.Pixel(x, y);
  return {static_cast<float>(rgb[0]), static_cast<float>(rgb[1]), static_cast<float>(rgb[2])};
}

// Returns the color between the texels at `u`, from left to right, and `v`, from bottom to top,
// both in [0, 1]; the picture repeats beyond its borders.
Eigen::Vector3f Bilinear(const Image& image, double u, double v) {
  const double x = u * image.width_px - 0.5;
  const double y = (1 - v) * image.height_px - 0.5;
  const double x_floor = std::floor(x);
  const double y_floor = std::floor(y);
  const auto wrap = [](double index, int size) {
    const int i = static_cast<int>(index) % size;
    return i < 0 ? i + size : i;
  };
  const int x0 = wrap(x_floor, image.width_px);
  const int x1 = wrap(x_floor + 1, image.width_px);
  const int y0 = wrap(y_floor, image.height_px);
  const int y1 = wrap(y_floor + 1, image.height_px);
  const auto fx = static_cast<float>(x - x_floor);
  const auto fy = static_cast<float>(y - y_floor);
  const Eigen::Vector3f upper = (1 - fx) * Texel(image, x0, y0) + fx * Texel(image, x1, y0);
  const Eigen::Vector3f lower = (1 - fx) * Texel(image, x0, y1) + fx * Texel(image, x1, y1);
  return (1 - fy) * upper + fy * lower;
}

// Returns a coordinate in [0, 1] by repetition, but 1 stays 1.
double Repeat(float coordinate) {
  if (!std::isfinite(coordinate)) return 0;
  if (coordinate >= 0 && coordinate <= 1) return static_cast<double>(coordinate);
  return static_cast<double>(coordinate) - std::floor(static_cast<double>(coordinate));
}

}  // namespace

Texture::Texture(const Image& image) : image_(&image) {
  const Image* last = &image;
  while (last->width_px > 1 || last->height_px > 1) {
    halved_.push_back(Halved(*last));
    last = &halved_.back();
  }
}

Eigen::Vector3f Texture::Sample(const Eigen::Vector2f& uv, double level) const {
  const double u = Repeat(uv.x());
  const double v = Repeat(uv.y());
  const double last = static_cast<double>(halved_.size());
  const double clamped = level > 0 ? std::min(level, last) : 0.0;
  const auto lower = static_cast<size_t>(clamped);
  const auto fraction = static_cast<float>(clamped - static_cast<double>(lower));
  Eigen::Vector3f fine = Bilinear(Level(lower), u, v);
  if (fraction == 0) return fine;
  return (1 - fraction) * fine + fraction * Bilinear(Level(lower + 1), u, v);
}

}  // namespace raylift
