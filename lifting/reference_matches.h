// Matches between references as one of the two sees them, and the depth that they triangulate. Each
// depth of a keypoint in a map puts it on another place of a line in the camera of its match.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "geometry/triangulation.h"
#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// One end of a match: the keypoint in one of its two references.
struct HalfMatch {
  Eigen::Vector2d pixel;
  int other;  // reference
  Eigen::Vector2d other_px;
};

// Returns both halves of every match, by the reference of the half, in the order of the matches.
std::vector<std::vector<HalfMatch>> HalvesByReference(std::span<const ReferenceMatch> matches,
                                                      size_t num_references);

// Returns the ray of a map's pixel in the other camera's frame, where ray_t is the depth z in the
// map; nullopt where the pixel has no ray in front of the map's image plane.
std::optional<SightLine> LineInOther(const PosedImage& map, const Eigen::Vector2d& pixel,
                                     const PosedImage& other);

// The depth at which the keypoint's ray passes closest to its match's ray.
struct TriangulatedDepth {
  double z;
  Eigen::Vector2d projected_px;  // in the other image
  // The pixels by which a unit of log z moves the projection: the more, the better the depth is
  // known.
  double gain_px;
};

// Returns nullopt where it lies behind either camera.
std::optional<TriangulatedDepth> TriangulateDepth(const SightLine& line_in_other,
                                                  const Camera& other_camera,
                                                  const Eigen::Vector2d& other_px);

// Returns the standard deviation of errors of which an unknown share is normal around 0 and the
// others, from wrong matches, are anywhere within the range: by expectation maximization.
double DeviationAmongOutliers(const std::vector<double>& errors_px, double range_px);

// The error of a projection by the line on which depth moves it: wrong depth adds only to the part
// along the line.
struct EpipolarError {
  double along_px;
  double across_px;
  double gain_px;  // by which one unit of log depth moves the projection
};

// Takes by how much one unit of log depth moves the projection; returns nullopt where it does not.
std::optional<EpipolarError> SplitByLine(const Eigen::Vector2d& error_px,
                                         const Eigen::Vector2d& motion_px);

// Tests the agreement of the references on lifted points: a query keypoint that was matched with
// several references has a lifted point from each of them, and every one of these points should
// project onto the matched keypoint of all the others.

// The error of a lifted point in one reference that observes its query keypoint.
struct ViewError {
  int reference;
  bool own;  // the point was lifted from this reference: it agrees trivially
  // `reference_px` is the keypoint matched in this reference (where the query keypoint is matched
  // with several of its keypoints, the one nearest to the projection), and `error_px` the
  // projection of the point relative to it; nullopt where the point is behind the reference or
  // outside its lens model's domain.
  Eigen::Vector2d reference_px;
  std::optional<Eigen::Vector2d> error_px;
};

// Computes the errors of all points of a query in all references that observe them.
class MultiViewErrors {
 public:
  // The points' query keypoints should occur in `matches_2d2d` (keypoints.h identifies keypoints);
  // a point of another keypoint has no views.
  MultiViewErrors(std::span<const PosedImage> references, std::span<const Match2D2D> matches_2d2d,
                  std::span<const Match2D3D> points);

  size_t num_points() const { return first_view_.size() - 1; }

  // Returns an error for each reference that observes the point's query keypoint, by reference.
  std::span<const ViewError> ViewsOf(size_t point) const {
    return std::span(views_).subspan(first_view_[point],
                                     first_view_[point + 1] - first_view_[point]);
  }

 private:
  std::vector<ViewError> views_;
  std::vector<size_t> first_view_;  // of each point, and the end
};

}  // namespace raylift
