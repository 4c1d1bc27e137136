// A picture that is painted in meters: the sheets that become the scene's textures.

#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/image.h"

namespace raylift::demo {

// sRGB values in [0, 1].
using Color = Eigen::Vector3f;

inline Color Mix(const Color& a, const Color& b, double t) {
  const auto weight = static_cast<float>(std::clamp(t, 0.0, 1.0));
  return (1 - weight) * a + weight * b;
}

inline Color Lit(const Color& color, double factor) { return color * static_cast<float>(factor); }

// In meters, y up.
struct Rect {
  double x0, y0, x1, y1;
  double width() const { return x1 - x0; }
  double height() const { return y1 - y0; }
  Rect Inset(double margin) const { return {x0 + margin, y0 + margin, x1 - margin, y1 - margin}; }
};

class Canvas {
 public:
  Canvas(double width_m, double height_m, double px_per_m);

  double width_m() const { return width_px_ / px_per_m_; }
  double height_m() const { return height_px_ / px_per_m_; }
  double px_per_m() const { return px_per_m_; }

  // Calls brush(x_m, y_m, color&) for every texel whose center is in the area.
  template <class Brush>
  void Paint(const Rect& area, Brush&& brush) {
    const int first_column = std::max(0, static_cast<int>(std::ceil(area.x0 * px_per_m_ - 0.5)));
    const int last_column =
        std::min(width_px_ - 1, static_cast<int>(std::floor(area.x1 * px_per_m_ - 0.5)));
    const int first_row =
        std::max(0, static_cast<int>(std::ceil(height_px_ - area.y1 * px_per_m_ - 0.5)));
    const int last_row = std::min(
        height_px_ - 1, static_cast<int>(std::floor(height_px_ - area.y0 * px_per_m_ - 0.5)));
    for (int row = first_row; row <= last_row; ++row) {
      for (int column = first_column; column <= last_column; ++column) {
        brush((column + 0.5) / px_per_m_, (height_px_ - row - 0.5) / px_per_m_,
              texels_[static_cast<size_t>(row) * width_px_ + column]);
      }
    }
  }

  // The texel that holds a place, which must be on the canvas.
  const Color& At(double x_m, double y_m) const {
    const int column = static_cast<int>(x_m * px_per_m_);
    const int row = static_cast<int>(height_px_ - y_m * px_per_m_);
    return texels_[static_cast<size_t>(row) * width_px_ + column];
  }

  void Fill(const Rect& area, const Color& color, double opacity = 1);
  void Disc(double x, double y, double radius, const Color& color, double opacity = 1);
  // One line of text that fills the area.
  void Text(const Rect& area, const std::string& text, const Color& color, double opacity = 1);

  Image ToImage() const;

 private:
  int width_px_;
  int height_px_;
  double px_per_m_;
  std::vector<Color> texels_;
};

}  // namespace raylift::demo
