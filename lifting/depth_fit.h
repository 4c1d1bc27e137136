// Fits a correction of one map's depth to its keypoints' matches in other references.

#pragma once

#include <span>
#include <vector>

#include "keypoint_sight.h"

#include "raylift/lifting/depth_alignment.h"

namespace raylift {

// A keypoint of a map and its match in another image.
struct DepthObservation {
  Eigen::Vector2d pixel;
  double z;  // as the source says
  KeypointSight sight;
  const Camera* other_camera;
  Eigen::Vector2d other_px;
};

// Of the matches near their epipolar lines whose keypoints have depth.
std::vector<DepthObservation> ObserveDepth(const GeometrySource& source,
                                           std::span<const PosedImage> references,
                                           const PosedImage& map,
                                           const std::vector<HalfMatch>& matches,
                                           const AlignOptions& options);

// How far the projections are from the matches; none is infinitely far.
std::vector<double> MatchDistances(const std::vector<DepthObservation>& observations,
                                   const Camera& camera, const DepthCorrection& correction);

double RobustLogFactor(const std::vector<DepthObservation>& observations);

// The correction of the options' mode (not off, not auto) that starts from one factor and fits the
// observations best.
DepthCorrection FitCorrection(const std::vector<DepthObservation>& observations,
                              const Camera& camera, double log_factor, const AlignOptions& options);

}  // namespace raylift
