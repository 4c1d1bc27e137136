// Lifts 2D-2D matches with references to 2D-3D matches with the scene: each reference pixel is
// lifted to the surface point that it shows.

#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// Several sources of geometry may each give a point for one keypoint.
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
// With kFirst a source is asked only for the matches that those before it could not lift.
LiftResult LiftMatches(std::span<const GeometrySource* const> sources, GeometryMode mode,
                       std::span<const PosedImage> references, std::span<const Match2D2D> matches);
LiftResult LiftMatches(const GeometrySource& source, std::span<const PosedImage> references,
                       std::span<const Match2D2D> matches);

// Returns the lifted matches as a PoseProblem holds them.
std::vector<Match2D3D> Matches2D3D(const LiftResult& result);

// Reduces the 3D points of a query keypoint to one. A keypoint that is matched with several
// references is lifted from each of them, and these candidates differ by the noise of matches and
// geometry. The paper keeps them all; MeshLoc (Panek et al., ECCV 2022) also merges them, or
// triangulates the matched reference keypoints and does without geometry.

enum class CandidateMode {
  kKeep,         // all of them
  kMerge,        // the one that the references agree on best, then refined
  kTriangulate,  // no geometry: the point that the matched keypoints' rays meet in
};
template <>
inline constexpr auto kEnumNames<CandidateMode> = std::to_array<EnumName<CandidateMode>>({
    {CandidateMode::kKeep, "keep"},
    {CandidateMode::kMerge, "merge"},
    {CandidateMode::kTriangulate, "triangulate"},
});

// A reference that observes the keypoint agrees with a point that projects within max_error_px of
// the matched keypoint. The cost of a point is the sum of min(error^2, max_error_px^2) over these
// references (MSAC). It is refined, by least squares over the references that agree, only where
// their rays meet at min_angle_deg at least: where they hardly differ, they say little of its
// depth.
struct CandidateOptions {
  CandidateMode mode = CandidateMode::kKeep;
  double max_error_px = 4;
  double min_angle_deg = 1;

  bool operator==(const CandidateOptions&) const = default;

  // Throws OptionError for a value out of its range.
  void Validate() const;
};

// Returns, of the points of each query keypoint, the one of the lowest cost, refined; it keeps the
// reference and the match that it was lifted from. Points are in the order in which the keypoints
// first occur in `points`.
std::vector<Match2D3D> MergeCandidates(std::span<const PosedImage> references,
                                       std::span<const Match2D2D> matches_2d2d,
                                       std::span<const Match2D3D> points,
                                       const CandidateOptions& options);

// Returns a point for each query keypoint on which two references or more agree whose rays meet at
// min_angle_deg at least: the best of the points of pairs of references, refined. It belongs to no
// single reference. Points are in the order in which the keypoints first occur in `matches_2d2d`.
std::vector<Match2D3D> TriangulateMatches(std::span<const PosedImage> references,
                                          std::span<const Match2D2D> matches_2d2d,
                                          const CandidateOptions& options);

}  // namespace raylift
