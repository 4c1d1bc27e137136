#include "atlas.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace raylift::demo {

Rect Atlas::Place(double width_m, double height_m) {
  // Whole texels, so that patches neither blur nor overlap.
  const double texel = 1 / canvas_.px_per_m();
  const double width = std::round(width_m / texel) * texel;
  const double height = std::round(height_m / texel) * texel;
  const double margin = 2 * kMarginPx * texel;
  if (shelf_x_m_ + width + margin > canvas_.width_m()) {
    shelf_x_m_ = 0;
    shelf_y_m_ += shelf_height_m_;
    shelf_height_m_ = 0;
  }
  shelf_height_m_ = std::max(shelf_height_m_, height + margin);
  if (shelf_y_m_ + shelf_height_m_ > canvas_.height_m()) {
    throw std::logic_error("the texture atlas is full");
  }
  const double x = shelf_x_m_ + margin / 2, y = shelf_y_m_ + margin / 2;
  shelf_x_m_ += width + margin;
  return {x, y, x + width, y + height};
}

Material Atlas::MaterialAt(const Rect& area) const {
  const Eigen::Vector2d size(canvas_.width_m(), canvas_.height_m());
  return {texture_,
          Eigen::Vector2d(area.x0, area.y0).cwiseQuotient(size),
          Eigen::Vector2d(area.x1, area.y1).cwiseQuotient(size),
          {area.width(), area.height()}};
}

}  // namespace raylift::demo
