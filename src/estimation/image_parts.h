// An image in n x n equal parts, to tell what lies together from what is spread over it; the images
// of a rig, one after the other.

#pragma once

#include <algorithm>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// Below parts_per_side^2, row by row; pixels outside of the image are in the nearest part.
inline int PartOfImage(const Camera& camera, const Eigen::Vector2d& pixel, int parts_per_side) {
  const auto along = [&](double at, int size) {
    return static_cast<int>(std::clamp(at / size * parts_per_side, 0.0, parts_per_side - 1.0));
  };
  return along(pixel.y(), camera.height_px()) * parts_per_side +
         along(pixel.x(), camera.width_px());
}

// Of a match's query pixel: below num_cameras() * parts_per_side^2.
template <typename Match>
int PartOfImages(const PoseProblem& problem, const Match& match, int parts_per_side) {
  return match.camera * parts_per_side * parts_per_side +
         PartOfImage(problem.CameraAt(match.camera), match.query_px, parts_per_side);
}

// Of the query's images, their mean.
inline double QueryAreaPx2(const PoseProblem& problem) {
  double sum = 0;
  for (int i = 0; i < problem.num_cameras(); ++i) {
    const Camera& camera = problem.CameraAt(i);
    sum += static_cast<double>(camera.width_px()) * static_cast<double>(camera.height_px());
  }
  return sum / problem.num_cameras();
}

}  // namespace raylift
