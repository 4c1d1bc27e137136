// The consistency filter without thresholds: how far each lifted point can be trusted follows from
// the multi-view errors alone.
//
// The error of a point in another reference has a part across the epipolar line, which only the
// keypoints' noise causes, and a part along it, which wrong depth adds to. Their distributions over
// all points of the query give the deviations s_n (keypoints) and s_a (along), and what the depth
// adds, s_g^2 = s_a^2 - s_n^2. Where s_g is of the order of s_n, the geometry is as good as the
// matches and all points are kept.
//
// Else the error in log depth of each point is estimated from its views: a view in which one unit
// of it moves the projection by g px along the line measures it as -a / g with deviation s_n / g;
// before any view it is 0 with deviation s_g / G, G being the median of g. The point's expected
// error in a further view, G sqrt(mean^2 + variance), must be of the order of s_n. So a point that
// no other reference sees well enough is as good as the geometry is on the whole.
//
// Whether geometry is accurate is better said by all queries of a scene together than by the few
// views of one.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "raylift/scene/pose_problem.h"

namespace raylift {

// Standard deviations in pixels of a reference.
struct MultiViewNoise {
  double keypoints_px = 0;
  double geometry_px = 0;  // what wrong depth adds along epipolar lines, at a typical baseline
  size_t num_views = 0;    // that say so

  bool operator==(const MultiViewNoise&) const = default;
};

struct PointTrust {
  bool seen_by_others = false;  // in a view that agrees across the epipolar line
  bool in_doubt = false;        // at least half of the views disagree there: a wrong match
  double expected_error_px = 0;
};

struct MultiViewTrust {
  MultiViewNoise noise;
  std::vector<PointTrust> points;
};

// None where there are too few views of several references to say anything.
std::optional<MultiViewTrust> EstimateTrust(std::span<const PosedImage> references,
                                            std::span<const Match2D2D> matches_2d2d,
                                            std::span<const Match2D3D> points);

// The noise of a scene from that of its queries, over all of their views. None of none.
std::optional<MultiViewNoise> PooledNoise(std::span<const MultiViewNoise> of_queries);

}  // namespace raylift
