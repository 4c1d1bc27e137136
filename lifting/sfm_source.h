// Lifts by the points of a COLMAP model: a reference's keypoint shows the 3D point that the model's
// own keypoint there was triangulated to. The points are sparse, and as exact as the model.

#pragma once

#include <cstddef>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "raylift/io/colmap_model.h"
#include "raylift/lifting/geometry_source.h"

namespace raylift {

struct SfmOptions {
  // Features that are not the model's own take the nearest of its keypoints with a 3D point within
  // this radius; with 0 they have no point.
  double radius_px = 2;
  // Points that fewer images observe, or whose mean reprojection error is larger, are not used.
  size_t min_track_length = 0;
  double max_error_px = std::numeric_limits<double>::infinity();
  SurfaceLimits limits = {};  // the surface around a point is not known: depth alone counts
};

// A keypoint that coincides with one of the model's is taken for that one: where it has no 3D
// point, there is none, however close its neighbors are. Where several coincide (one place, several
// orientations) the 3D point of the longest track is taken.
class SfmSource final : public GeometrySource {
 public:
  // Takes what it needs of the model.
  SfmSource(std::string description, const ColmapModel& model, const SfmOptions& options = {});
  ~SfmSource() override;

  std::string Description() const override;
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override;

 private:
  struct Impl;
  std::unique_ptr<const Impl> impl_;
};

// Says whether a model can serve these references.
struct SfmFit {
  std::string interpretation;         // "3375 points, tracks of 3 images (median), ..."
  std::vector<std::string> warnings;  // references that it does not hold, another coordinate frame
};
SfmFit CheckSfmModel(const ColmapModel& model, std::span<const PosedImage> references);

}  // namespace raylift
