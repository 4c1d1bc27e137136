// Turns matches between pictures into matches between a picture and the scene: each reference pixel
// is lifted to the surface point that it shows.

#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// What several sources of geometry give for one keypoint.
enum class GeometryMode {
  kFirst,  // the point of the first source that has one
  kAll,    // the points of all sources that have one
};
template <>
inline constexpr auto kEnumNames<GeometryMode> = std::to_array<EnumName<GeometryMode>>({
    {GeometryMode::kFirst, "first"},
    {GeometryMode::kAll, "all"},
});

struct LiftedMatch {
  Match2D3D match;       // with the reference and the 2D-2D match that it was lifted from
  SurfacePoint surface;  // where, and how far it can be trusted
  size_t source = 0;     // index of the source that it is from
};

struct LiftCounts {
  size_t matches = 0;
  size_t hits = 0;  // matches that were lifted, by one source or several
  size_t misses = 0;
  size_t back_faces = 0;                 // of the lifted points
  std::vector<size_t> points_of_source;  // how many each source gave
};

struct LiftResult {
  std::vector<LiftedMatch> lifted;  // in the order of the 2D-2D matches, then of the sources
  LiftCounts counts;
};

// Lifts every match whose reference pixel shows a surface, in one batch per reference and source.
// With kFirst a source is asked only for what those before it do not know.
LiftResult LiftMatches(std::span<const GeometrySource* const> sources, GeometryMode mode,
                       std::span<const PosedImage> references, std::span<const Match2D2D> matches);
LiftResult LiftMatches(const GeometrySource& source, std::span<const PosedImage> references,
                       std::span<const Match2D2D> matches);

// The lifted matches as a PoseProblem holds them.
std::vector<Match2D3D> Matches2D3D(const LiftResult& result);

}  // namespace raylift
