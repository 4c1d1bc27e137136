// Networks take pictures of few sizes: they stretch, cut or pad a photograph before they make a map
// of it. Cut and padded maps are laid into the photograph again here, sample by sample.

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/read_limits.h"
#include "lifting/depth_convention.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// The size of the photograph in samples of the map, and where the map begins in it (negative: in
// the padding).
struct Layout {
  PlaneSize image;
  int left = 0;
  int top = 0;
};

int Rounded(double value, int multiple = 1) {
  const double bounded = std::min(value, 1e9);  // more than any map has
  return multiple *
         static_cast<int>(std::nearbyint(bounded / multiple));  // as Python: half to even
}

Layout LayoutOf(MapFit fit, PlaneSize map, PlaneSize image) {
  constexpr int kPatchPx = 14;
  const double map_w = map.width_px, map_h = map.height_px;
  const double image_w = image.width_px, image_h = image.height_px;
  const double width_by_height = image_w * map_h / image_h;
  const double height_by_width = image_h * map_w / image_w;
  const bool covers_by_width = height_by_width >= map_h;
  PlaneSize resized = map;
  switch (fit) {
    case MapFit::kWhole:
      break;
    case MapFit::kCrop:
      (covers_by_width ? resized.height_px : resized.width_px) =
          Rounded(covers_by_width ? height_by_width : width_by_height);
      break;
    case MapFit::kCropFloor: {
      constexpr double kAsInTheirCode = 1e-8;
      const double scale = std::max(map_w / image_w, map_h / image_h) + kAsInTheirCode;
      resized = {static_cast<int>(image_w * scale), static_cast<int>(image_h * scale)};
      return {resized, Rounded(0.5 * (resized.width_px - map.width_px)),
              Rounded(0.5 * (resized.height_px - map.height_px))};
    }
    case MapFit::kWidth:
      resized.height_px = Rounded(height_by_width, kPatchPx);
      break;
    case MapFit::kPad:
      (covers_by_width ? resized.width_px : resized.height_px) =
          Rounded(covers_by_width ? width_by_height : height_by_width, kPatchPx);
      break;
  }
  return {resized, (resized.width_px - map.width_px) / 2, (resized.height_px - map.height_px) / 2};
}

}  // namespace

StoredDepth OnWholeImage(StoredDepth map, MapFit fit, PlaneSize image,
                         const std::filesystem::path& file_for_messages) {
  const Layout layout = LayoutOf(fit, {map.width_px, map.height_px}, image);
  if (layout.image == PlaneSize{map.width_px, map.height_px}) return map;
  const auto width = static_cast<size_t>(layout.image.width_px);
  const auto height = static_cast<size_t>(layout.image.height_px);
  if (width == 0 || height == 0 || width * height > kMaxDepthMapPixels) {
    throw InputError(
        file_for_messages,
        fmt::format("a map of {} x {} cannot be a part ({}) of an image of {} x {}", map.width_px,
                    map.height_px, ToString(fit), image.width_px, image.height_px));
  }
  std::vector<float> values(width * height);
  const int x0 = std::max(layout.left, 0);
  const int x1 = std::min(layout.left + map.width_px, layout.image.width_px);
  for (int y = std::max(layout.top, 0);
       y < std::min(layout.top + map.height_px, layout.image.height_px); ++y) {
    const auto row = map.values.begin() + std::ptrdiff_t{y - layout.top} * map.width_px;
    std::copy(row + (x0 - layout.left), row + (x1 - layout.left),
              values.begin() + static_cast<std::ptrdiff_t>(y) * layout.image.width_px + x0);
  }
  map.values = std::move(values);
  map.width_px = layout.image.width_px;
  map.height_px = layout.image.height_px;
  return map;
}

}  // namespace raylift
