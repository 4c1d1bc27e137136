// Fits the correction of one map by the matches of its keypoints in other images.

#pragma once

#include <optional>
#include <span>
#include <vector>

#include "geometry/triangulation.h"
#include "lifting/reference_matches.h"
#include <Eigen/Core>

#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/geometry_source.h"

namespace raylift {

// The width of Cauchy's loss of the residuals.
inline constexpr double kLossWidthPx = 2;

// A keypoint of a map and its match in another image.
struct DepthObservation {
  Eigen::Vector2d pixel;
  double z;  // as the source says
  int other;
  double epipolar_px;       // distance of the match from the epipolar line
  SightLine line_in_other;  // ray_t is the depth in the map
  const Camera* other_camera;
  Eigen::Vector2d other_px;
};

// Returns the matches of a map's keypoints that have depth, up to so many pixels from their
// epipolar lines.
std::vector<DepthObservation> ObserveDepth(const GeometrySource& source,
                                           std::span<const PosedImage> references,
                                           const PosedImage& map,
                                           const std::vector<HalfMatch>& matches,
                                           double max_epipolar_px);

// A map's log factor before a fit, with its standard deviation.
struct KnownFactor {
  double log_factor;
  double sigma;
  // The number of neighboring matches that count as one that is independent.
  double repeats;
};

// Returns the correction of a mode (not off, not auto) that starts from one factor and
// fits the observations best; the mean of its factors also fits what is known of it, if that is.
DepthCorrection FitCorrection(const std::vector<DepthObservation>& observations,
                              const Camera& camera, double log_factor,
                              const std::optional<KnownFactor>& known, AlignMode mode);

}  // namespace raylift
