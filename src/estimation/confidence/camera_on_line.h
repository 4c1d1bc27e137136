// Where matches are inliers, as the camera moves along a line.

#pragma once

#include <cstddef>
#include <optional>

#include "estimation/problem/normalized_problem.h"
#include <Eigen/Core>

namespace raylift {

// Where a match is an inlier, as the camera moves along a line.
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

  // By the squared reprojection error.
  std::optional<InlierRange> InlierInterval(const NormalizedMatch2D3D& match) const;
  // By the squared Sampson error.
  std::optional<InlierRange> InlierInterval(const NormalizedMatch2D2D& match) const;
  // By how another reference sees the point of a match with the one that the line goes through.
  std::optional<InlierRange> InlierInterval(const NormalizedMatch2D2D& of_dominant,
                                            const NormalizedMatch2D2D& of_other) const;

 private:
  const NormalizedProblem& problem_;
  const CamFromLocal& pose_;
  Eigen::Vector3d direction_;
};

}  // namespace raylift
