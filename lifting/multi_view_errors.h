// Agreement of the references on lifted points: a query keypoint that was matched with several
// references has a lifted point from each of them, and every one of these points should project
// onto the matched keypoint of all the others.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/pose_problem.h"

namespace raylift {

// A lifted point as one reference that observes its query keypoint sees it.
struct ViewError {
  int reference;
  bool own;  // the point was lifted from this reference: it agrees trivially
  // The keypoint matched in this reference (where the query keypoint is matched with several of
  // its keypoints, the one nearest to the projection), and where the point projects relative to
  // it; none where it is behind the reference or outside its lens model's domain.
  Eigen::Vector2d reference_px;
  std::optional<Eigen::Vector2d> error_px;
};

// The views of all points of a query, point by point.
class MultiViewErrors {
 public:
  // All points' query keypoints should occur in `matches_2d2d` (keypoints.h says which keypoint a
  // match is of); a point of another keypoint has no views.
  MultiViewErrors(std::span<const PosedImage> references, std::span<const Match2D2D> matches_2d2d,
                  std::span<const Match2D3D> points);

  size_t num_points() const { return first_view_.size() - 1; }

  // One for each reference that observes the point's query keypoint, by reference.
  std::span<const ViewError> ViewsOf(size_t point) const {
    return std::span(views_).subspan(first_view_[point],
                                     first_view_[point + 1] - first_view_[point]);
  }

 private:
  std::vector<ViewError> views_;
  std::vector<size_t> first_view_;  // of each point, and the end
};

}  // namespace raylift
