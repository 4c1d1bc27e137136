// Turns matches between pictures into matches between a picture and the scene: each reference pixel
// is lifted to the surface point that it shows.

#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct LiftedMatch {
  Match2D3D match;       // with the reference it was lifted from
  SurfacePoint surface;  // where, and how far it can be trusted
  size_t match_2d2d;     // index of the 2D-2D match that it comes from
};

struct LiftCounts {
  size_t matches = 0;
  size_t hits = 0;
  size_t misses = 0;
  size_t back_faces = 0;  // of the hits
};

struct LiftResult {
  std::vector<LiftedMatch> lifted;  // in the order of the 2D-2D matches
  LiftCounts counts;
};

// Lifts every match whose reference pixel shows a surface, in one batch per reference.
LiftResult LiftMatches(const GeometrySource& geometry, std::span<const PosedImage> references,
                       std::span<const Match2D2D> matches);

// The lifted matches as a PoseProblem holds them.
std::vector<Match2D3D> Matches2D3D(const LiftResult& result);

}  // namespace raylift
