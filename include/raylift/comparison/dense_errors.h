// DCRE of whole results: what each photograph shows comes from a source of geometry at the true
// pose.

#pragma once

#include <span>
#include <string>
#include <vector>

#include "raylift/evaluation/dcre.h"
#include "raylift/evaluation/pose_errors.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The surface points of a grid of about `count` pixels.
std::vector<DensePoint> SeenPoints(const GeometrySource& source, const PosedImage& true_view,
                                   int count);

// Per result, per query, in the order of `true_views`. `matched_poses` holds each result's poses by
// the true views' names (MatchNames).
std::vector<std::vector<DcreQuery>> MeasureDcre(const GeometrySource& source,
                                                std::span<const PosedImage> true_views,
                                                std::span<const PosesByName> matched_poses,
                                                int count, int threads);

}  // namespace raylift
