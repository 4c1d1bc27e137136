// Lifted keypoints against their matches in other images.

#pragma once

#include <span>
#include <vector>

#include "raylift/comparison/depth_comparison.h"

namespace raylift {

// Distances in pixels of keypoints of one image, lifted and projected, from their matches.
struct LiftedMatchErrors {
  std::vector<double> errors_px;
  size_t missing = 0;
};

// Both ends of every match, by the image that is lifted from.
std::vector<LiftedMatchErrors> MeasureMatches(const GeometrySource& source,
                                              std::span<const PosedImage> images,
                                              std::span<const ReferenceMatch> matches, int threads);

// None where there are no matches.
std::optional<MatchErrors> SummarizeMatches(std::span<const LiftedMatchErrors* const> errors);

// The corrections that matches ask for, turned round: by how much depth is wrong.
struct MatchScales {
  std::vector<std::optional<double>> log_scales;  // one per image
  std::optional<double> warp_sigma;
};
MatchScales ScalesByMatches(const GeometrySource& source, std::span<const PosedImage> images,
                            std::span<const ReferenceMatch> matches, int threads);

}  // namespace raylift
