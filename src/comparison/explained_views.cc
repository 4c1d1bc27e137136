#include "explained_views.h"

#include <algorithm>
#include <numeric>

#include "raylift/base/parallel.h"
#include "raylift/comparison/source_view.h"

namespace raylift {
namespace {

// A misalignment is one for all images: a few tell it as well as all.
constexpr size_t kMaxViews = 8;
// Larger than what is compared else: steps of values show at a map's own pixels alone, not between.
constexpr int kMaxSidePx = 1024;

}  // namespace

std::vector<ExplainedView> ViewsToExplain(const GeometrySource& source, const GeometrySource& truth,
                                          std::span<const PosedImage> images, int threads) {
  std::vector<size_t> by_name(images.size());
  std::iota(by_name.begin(), by_name.end(), size_t{0});
  std::stable_sort(by_name.begin(), by_name.end(),
                   [&](size_t a, size_t b) { return images[a].name < images[b].name; });
  const size_t count = std::min(kMaxViews, images.size());
  std::vector<ExplainedView> views(count);
  ParallelFor(count, threads, [&](size_t k) {
    // The middles of equal parts.
    const size_t place = (2 * k + 1) * images.size() / (2 * count);
    const PosedImage& original = images[by_name[place]];
    const PosedImage image = ShrunkTo(original, kMaxSidePx);
    ExplainedView& view = views[k];
    view.camera = image.camera;
    view.image_px = static_cast<double>(original.camera.width_px()) / image.camera.width_px();
    view.estimated = LookThrough(source, image).depth;
    view.truth = LookThrough(truth, image).depth;
    for (int offset = -kMaxFrames; offset <= kMaxFrames; ++offset) {
      const auto other = static_cast<std::ptrdiff_t>(place) + offset;
      if (other < 0 || other >= static_cast<std::ptrdiff_t>(images.size())) continue;
      const PosedImage& frame = images[by_name[static_cast<size_t>(other)]];
      view.frames_from_cam[static_cast<size_t>(offset + kMaxFrames)] =
          frame.cam_from_world * image.cam_from_world.Inverse();
    }
  });
  return views;
}

}  // namespace raylift
