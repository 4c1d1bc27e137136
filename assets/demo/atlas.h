// One sheet for the textures of all things that are no facade and no ground.

#pragma once

#include <algorithm>

#include "canvas.h"
#include "mesh_builder.h"

namespace raylift::demo {

class Atlas {
 public:
  Atlas(int texture, double width_m, double height_m, double px_per_m)
      : texture_(texture), canvas_(width_m, height_m, px_per_m) {}

  const Canvas& canvas() const { return canvas_; }

  // Places a width x height (meters) patch and paints it: brush(x, y) -> Color, with (0, 0) at its
  // lower left. The colors continue a little beyond the patch, for filters that look there.
  template <class Brush>
  Material Add(double width_m, double height_m, Brush&& brush) {
    const Rect area = Place(width_m, height_m);
    canvas_.Paint(area.Inset(-kMarginPx / canvas_.px_per_m()), [&](double x, double y,
                                                                   Color& texel) {
      texel = brush(std::clamp(x - area.x0, 0.0, width_m), std::clamp(y - area.y0, 0.0, height_m));
    });
    return MaterialAt(area);
  }

  // Paints over a patch that was added: draw(canvas, its area).
  template <class Draw>
  void Decorate(const Material& material, Draw&& draw) {
    const Eigen::Vector2d size(canvas_.width_m(), canvas_.height_m());
    const Eigen::Vector2d low = material.uv_min.cwiseProduct(size);
    const Eigen::Vector2d high = material.uv_max.cwiseProduct(size);
    draw(canvas_, Rect{low.x(), low.y(), high.x(), high.y()});
  }

 private:
  static constexpr double kMarginPx = 2;

  // On shelves, from the lower left to the upper right.
  Rect Place(double width_m, double height_m);
  Material MaterialAt(const Rect& area) const;

  int texture_;
  Canvas canvas_;
  double shelf_x_m_ = 0;
  double shelf_y_m_ = 0;
  double shelf_height_m_ = 0;
};

}  // namespace raylift::demo
