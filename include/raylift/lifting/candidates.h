// One 3D point per query keypoint. A keypoint that is matched with several references is lifted
// from each of them, and these candidates differ by the noise of matches and geometry. The paper
// keeps them all; MeshLoc (Panek et al., ECCV 2022) also merges them, or triangulates the matched
// reference keypoints and does without geometry.

#pragma once

#include <span>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

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

// Of the points of each query keypoint the one of the lowest cost, refined; it keeps the reference
// and the match that it was lifted from. In the order in which the keypoints first occur in
// `points`.
std::vector<Match2D3D> MergeCandidates(std::span<const PosedImage> references,
                                       std::span<const Match2D2D> matches_2d2d,
                                       std::span<const Match2D3D> points,
                                       const CandidateOptions& options);

// A point for each query keypoint on which two references or more agree whose rays meet at
// min_angle_deg at least: the best of the points of pairs of references, refined. It is of no
// single reference. In the order in which the keypoints first occur in `matches_2d2d`.
std::vector<Match2D3D> TriangulateMatches(std::span<const PosedImage> references,
                                          std::span<const Match2D2D> matches_2d2d,
                                          const CandidateOptions& options);

}  // namespace raylift
