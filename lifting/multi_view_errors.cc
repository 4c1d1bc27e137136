#include "raylift/lifting/multi_view_errors.h"

#include <algorithm>
#include <map>
#include <utility>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// A query pixel as a key: keypoints are equal where their coordinates are.
using PixelKey = std::pair<double, double>;

PixelKey KeyOf(const Eigen::Vector2d& pixel) { return {pixel.x(), pixel.y()}; }

// The matches of each query keypoint, by reference.
using MatchesByKeypoint = std::map<PixelKey, std::vector<const Match2D2D*>>;

MatchesByKeypoint GroupByKeypoint(std::span<const Match2D2D> matches) {
  MatchesByKeypoint groups;
  for (const Match2D2D& match : matches) {
    groups[KeyOf(match.query_px)].push_back(&match);
  }
  for (auto& [pixel, group] : groups) {
    std::stable_sort(group.begin(), group.end(), [](const Match2D2D* a, const Match2D2D* b) {
      return a->reference < b->reference;
    });
  }
  return groups;
}

// `matches` are those of one keypoint with one reference.
ViewError ErrorInView(const PosedImage& reference, std::span<const Match2D2D* const> matches,
                      const Match2D3D& point) {
  ViewError view{.reference = matches.front()->reference,
                 .own = point.reference == matches.front()->reference,
                 .reference_px = matches.front()->reference_px,
                 .error_px = std::nullopt};
  const auto projected =
      reference.camera.ImgFromCam(reference.cam_from_world * point.point_in_world);
  if (!projected) return view;
  for (const Match2D2D* match : matches) {
    const Eigen::Vector2d error_px = *projected - match->reference_px;
    if (!view.error_px || error_px.squaredNorm() < view.error_px->squaredNorm()) {
      view.reference_px = match->reference_px;
      view.error_px = error_px;
    }
  }
  return view;
}

}  // namespace

MultiViewErrors::MultiViewErrors(std::span<const PosedImage> references,
                                 std::span<const Match2D2D> matches_2d2d,
                                 std::span<const Match2D3D> points) {
  const MatchesByKeypoint groups = GroupByKeypoint(matches_2d2d);
  first_view_.push_back(0);
  for (const Match2D3D& point : points) {
    if (const auto group = groups.find(KeyOf(point.query_px)); group != groups.end()) {
      const std::span matches(group->second);
      for (size_t begin = 0, end = 0; begin < matches.size(); begin = end) {
        const int reference = matches[begin]->reference;
        while (end < matches.size() && matches[end]->reference == reference) ++end;
        views_.push_back(ErrorInView(references[static_cast<size_t>(reference)],
                                     matches.subspan(begin, end - begin), point));
      }
    }
    first_view_.push_back(views_.size());
  }
}

}  // namespace raylift
