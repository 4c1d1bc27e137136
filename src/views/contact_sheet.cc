#include <algorithm>
#include <cmath>
#include <iterator>
#include <span>

#include "base/index_sets.h"
#include "base/statistics.h"
#include "renderers/view_frame.h"
#include "views/job_files.h"
#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "raylift/base/parallel.h"
#include "raylift/renderers/frame_renderer.h"

namespace raylift {
namespace {

constexpr int kTileSide = 240;  // pixels, of the longer side
constexpr int kCaption = 16;    // pixels, below each tile
constexpr int kGap = 4;
constexpr double kFarPercentile = 0.98;
constexpr double kNearPercentile = 0.02;

struct Tile {
  std::string caption;
  int width_px = 0;
  int height_px = 0;
  std::vector<float> depth;
};

std::string FileName(const std::string& name, size_t max_length) {
  return name.size() <= max_length ? name : "..." + name.substr(name.size() - max_length + 3);
}

Tile RenderTile(const FrameRenderer& renderer, const PosedImage& view) {
  Frame frame = RenderScaled(renderer, view, kTileSide);
  Tile tile{"", frame.width_px, frame.height_px, std::move(frame.depth)};
  float low = 0;
  float high = 0;
  for (const float z : tile.depth) {
    if (z > 0 && (low == 0 || z < low)) low = z;
    high = std::max(high, z);
  }
  tile.caption = fmt::format(
      "{}  {:.0f} %  {:.3g} - {:.3g}", FileName(view.name, 18),
      100.0 * static_cast<double>(frame.num_hits) / static_cast<double>(tile.depth.size()), low,
      high);
  return tile;
}

struct LogScale {
  double near = 0;  // logarithms
  double far = 1;

  uint8_t Level(float z) const {  // 255: near
    const double share = (std::log(z) - near) / std::max(far - near, 1e-9);
    return static_cast<uint8_t>(std::lround(255 * (1 - std::clamp(share, 0.0, 1.0))));
  }
};

LogScale ScaleOf(const std::vector<Tile>& tiles) {
  std::vector<float> depths;
  for (const Tile& tile : tiles) {
    std::copy_if(tile.depth.begin(), tile.depth.end(), std::back_inserter(depths),
                 [](float z) { return z > 0; });
  }
  if (depths.empty()) return {};
  const auto percentile = [&depths](double share) {
    return std::log(double{QuantileInPlace(std::span(depths), share)});
  };
  return {percentile(kNearPercentile), percentile(kFarPercentile)};
}

void Draw(const Tile& tile, const LogScale& scale, cv::Mat target) {
  cv::Mat levels(tile.height_px, tile.width_px, CV_8U);
  for (size_t i = 0; i < tile.depth.size(); ++i) {
    levels.data[i] = tile.depth[i] > 0 ? scale.Level(tile.depth[i]) : uint8_t{0};
  }
  cv::Mat colors;
  cv::applyColorMap(levels, colors, cv::COLORMAP_TURBO);
  for (size_t i = 0; i < tile.depth.size(); ++i) {
    if (!(tile.depth[i] > 0)) std::fill_n(colors.data + 3 * i, 3, uint8_t{0});
  }
  const cv::Rect place((kTileSide - tile.width_px) / 2,
                       (target.rows - kCaption - tile.height_px) / 2, tile.width_px,
                       tile.height_px);
  colors.copyTo(target(place));
  cv::putText(target, tile.caption, {2, target.rows - 5}, cv::FONT_HERSHEY_PLAIN, 0.7,
              {255, 255, 255}, 1, cv::LINE_AA);
}

}  // namespace

Image MakeContactSheet(const std::shared_ptr<const RayCaster>& scene,
                       const std::vector<PosedImage>& views, int threads) {
  FrameOptions options;
  options.depth = true;
  const FrameRenderer renderer(scene, options);
  const std::vector<size_t> shown = EvenlySpaced(views.size(), static_cast<size_t>(kMaxTiles));
  const size_t count = shown.size();
  std::vector<Tile> tiles(count);
  ParallelFor(count, threads, [&](size_t i) { tiles[i] = RenderTile(renderer, views[shown[i]]); });
  int tallest = 1;
  for (const Tile& tile : tiles) tallest = std::max(tallest, tile.height_px);
  const int columns =
      std::clamp(static_cast<int>(std::ceil(std::sqrt(static_cast<double>(count)))), 1, 8);
  const int rows = std::max(1, (static_cast<int>(count) + columns - 1) / columns);
  const cv::Size cell(kTileSide, tallest + kCaption);
  cv::Mat sheet =
      cv::Mat::zeros(rows * (cell.height + kGap), columns * (cell.width + kGap), CV_8UC3);
  const LogScale scale = ScaleOf(tiles);
  for (int i = 0; i < static_cast<int>(count); ++i) {
    Draw(tiles[static_cast<size_t>(i)], scale,
         sheet(cv::Rect({i % columns * (cell.width + kGap), i / columns * (cell.height + kGap)},
                        cell)));
  }
  cv::cvtColor(sheet, sheet, cv::COLOR_BGR2RGB);
  return {sheet.cols, sheet.rows, 3, std::vector<uint8_t>(sheet.datastart, sheet.dataend)};
}

}  // namespace raylift
