#include "curve_order.h"

#include <algorithm>
#include <array>
#include <cstddef>

namespace raylift {
namespace {

constexpr uint32_t kSide = 64;  // cells

// The bits of a number below 2^8, with zeros between them.
uint32_t SpreadBits(uint32_t value) {
  value = (value | value << 4) & 0x0f0fu;
  value = (value | value << 2) & 0x3333u;
  return (value | value << 1) & 0x5555u;
}

// What is no number is somewhere, too.
uint32_t CellAlong(double cells) {
  return cells > 0 ? static_cast<uint32_t>(std::min<double>(cells, kSide - 1)) : 0;
}

}  // namespace

std::vector<uint32_t> OrderAlongCurve(const Camera& camera,
                                      std::span<const Eigen::Vector2d> pixels) {
  const Eigen::Vector2d cells_per_px(kSide / static_cast<double>(camera.width_px()),
                                     kSide / static_cast<double>(camera.height_px()));
  std::vector<uint32_t> cell_of_pixel;
  cell_of_pixel.reserve(pixels.size());
  std::array<uint32_t, size_t{kSide} * kSide + 1> next{};  // place of each cell's next pixel
  for (const Eigen::Vector2d& pixel : pixels) {
    const uint32_t cell = SpreadBits(CellAlong(pixel.x() * cells_per_px.x())) |
                          SpreadBits(CellAlong(pixel.y() * cells_per_px.y())) << 1;
    cell_of_pixel.push_back(cell);
    ++next[cell + 1];
  }
  for (size_t cell = 0; cell + 1 < next.size(); ++cell) next[cell + 1] += next[cell];
  std::vector<uint32_t> order(pixels.size());
  for (uint32_t i = 0; i < pixels.size(); ++i) order[next[cell_of_pixel[i]]++] = i;
  return order;
}

}  // namespace raylift
