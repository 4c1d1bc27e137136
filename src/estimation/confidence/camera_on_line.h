// Computes the intervals of a line on which matches are inliers as the camera moves along it.

#pragma once

#include <cstddef>
#include <optional>

#include "estimation/problem/normalized_problem.h"
#include <Eigen/Core>

namespace raylift {

// The interval of the camera's displacement x along the line in which a match is an inlier.
struct InlierRange {
  double begin, end;
  size_t keypoint;

  bool Contains(double x) const { return begin < x && x < end; }
};

// The camera moves by x along `direction` (local axes), its axes unchanged. Squared residuals are
// ratios of two squares of linear functions of x, so that the bounds of an interval are roots of a
// quadratic. Each returns nullopt where that is not one bounded interval in front of the cameras.
class CameraOnLine {
 public:
  CameraOnLine(const NormalizedProblem& problem, const CamFromLocal& pose,
               const Eigen::Vector3d& direction)
      : problem_(problem), pose_(pose), direction_(direction) {}

  // Returns the interval of a 2D-3D match, by the squared reprojection error.
  std::optional<InlierRange> InlierInterval(const NormalizedMatch2D3D& match) const;
  // Returns the interval of a 2D-2D match, by the squared Sampson error.
  std::optional<InlierRange> InlierInterval(const NormalizedMatch2D2D& match) const;
  // Returns the interval in which another reference sees, within the threshold, the point that the
  // query and the dominant reference (which the line goes through) triangulate.
  std::optional<InlierRange> InlierInterval(const NormalizedMatch2D2D& of_dominant,
                                            const NormalizedMatch2D2D& of_other) const;

 private:
  const NormalizedProblem& problem_;
  const CamFromLocal& pose_;
  Eigen::Vector3d direction_;
};

}  // namespace raylift
