#include "lifting/multi_view_errors.h"

#include <algorithm>

#include "raylift/base/error.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

// `of_view` are the matches of one keypoint with one reference.
ViewError ErrorInView(const PosedImage& reference, std::span<const Match2D2D> matches,
                      std::span<const size_t> of_view, const Match2D3D& point) {
  const Match2D2D& first = matches[of_view.front()];
  ViewError view{.reference = first.reference,
                 .own = point.reference == first.reference,
                 .reference_px = first.reference_px,
                 .error_px = std::nullopt};
  const auto projected =
      reference.camera.ImgFromCam(reference.cam_from_world * point.point_in_world);
  if (!projected) return view;
  for (const size_t i : of_view) {
    const Eigen::Vector2d error_px = *projected - matches[i].reference_px;
    if (!view.error_px || error_px.squaredNorm() < view.error_px->squaredNorm()) {
      view.reference_px = matches[i].reference_px;
      view.error_px = error_px;
    }
  }
  return view;
}

}  // namespace

MultiViewErrors::MultiViewErrors(std::span<const PosedImage> references,
                                 std::span<const Match2D2D> matches_2d2d,
                                 std::span<const Match2D3D> points) {
  const KeypointNumbers keypoints = NumberQueryKeypoints(matches_2d2d, points);
  auto groups = GroupByKeypoint(keypoints.of_2d2d, keypoints.count);
  for (std::vector<size_t>& group : groups) {
    std::stable_sort(group.begin(), group.end(), [&](size_t a, size_t b) {
      return matches_2d2d[a].reference < matches_2d2d[b].reference;
    });
  }
  first_view_.push_back(0);
  for (size_t i = 0; i < points.size(); ++i) {
    const std::span group(groups[keypoints.of_2d3d[i]]);
    for (size_t begin = 0, end = 0; begin < group.size(); begin = end) {
      const int reference = matches_2d2d[group[begin]].reference;
      while (end < group.size() && matches_2d2d[group[end]].reference == reference) ++end;
      views_.push_back(ErrorInView(references[static_cast<size_t>(reference)], matches_2d2d,
                                   group.subspan(begin, end - begin), points[i]));
    }
    first_view_.push_back(views_.size());
  }
}

}  // namespace raylift
