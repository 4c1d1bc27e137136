#include "canvas.h"

#include <opencv2/imgproc.hpp>

namespace raylift::demo {

Canvas::Canvas(double width_m, double height_m, double px_per_m)
    : width_px_(static_cast<int>(std::lround(width_m * px_per_m))),
      height_px_(static_cast<int>(std::lround(height_m * px_per_m))),
      px_per_m_(px_per_m),
      texels_(static_cast<size_t>(width_px_) * height_px_, Color::Constant(0.5f)) {}

void Canvas::Fill(const Rect& area, const Color& color, double opacity) {
  Paint(area, [&](double, double, Color& texel) { texel = Mix(texel, color, opacity); });
}

void Canvas::Disc(double x, double y, double radius, const Color& color, double opacity) {
  Paint({x - radius, y - radius, x + radius, y + radius}, [&](double px, double py, Color& texel) {
    const double inside_px = (radius - std::hypot(px - x, py - y)) * px_per_m_ + 0.5;
    texel = Mix(texel, color, opacity * std::clamp(inside_px, 0.0, 1.0));
  });
}

void Canvas::Text(const Rect& area, const std::string& text, const Color& color, double opacity) {
  constexpr int kFont = cv::FONT_HERSHEY_DUPLEX;
  constexpr double kScale = 3;
  constexpr int kThickness = 7;
  int baseline = 0;
  const cv::Size size = cv::getTextSize(text, kFont, kScale, kThickness, &baseline);
  cv::Mat mask = cv::Mat::zeros(size.height + baseline, size.width, CV_8UC1);
  cv::putText(mask, text, {0, size.height}, kFont, kScale, 255, kThickness, cv::LINE_AA);
  cv::resize(mask, mask,
             {std::max(1, static_cast<int>(area.width() * px_per_m_)),
              std::max(1, static_cast<int>(area.height() * px_per_m_))},
             0, 0, cv::INTER_AREA);
  Paint(area, [&](double x, double y, Color& texel) {
    // A texel whose center is on the area's edge may round to one beyond the mask.
    const int column =
        std::clamp(static_cast<int>((x - area.x0) / area.width() * mask.cols), 0, mask.cols - 1);
    const int row =
        std::clamp(static_cast<int>((area.y1 - y) / area.height() * mask.rows), 0, mask.rows - 1);
    texel = Mix(texel, color, opacity * mask.at<uint8_t>(row, column) / 255.0);
  });
}

Image Canvas::ToImage() const {
  Image image{width_px_, height_px_, 3, std::vector<uint8_t>(texels_.size() * 3)};
  for (size_t i = 0; i < texels_.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      image.data[3 * i + c] =
          static_cast<uint8_t>(std::lround(255 * std::clamp(texels_[i][c], 0.0f, 1.0f)));
    }
  }
  return image;
}

}  // namespace raylift::demo
