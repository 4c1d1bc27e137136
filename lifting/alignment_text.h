// Describes the alignment of depth and the calibrated confidences in words.

#pragma once

#include <optional>
#include <string>

#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/depth_confidence.h"

namespace raylift {

// Returns "by grid: keypoints were 16.60 px from their matches, now 3.35 px (median)"; "is left as
// read" where the mode is off.
std::string Describe(const DepthAlignment& alignment);

// Returns "confidences tell how noisy the depth is: 15 % at 1.02, 1.1 % at 1.9"; "... nothing ..."
std::string Describe(const ConfidenceWorth& worth);

// Names the references whose factors their own matches do not determine, and those whose own
// factors are far from the others' and rest on few matches; nullopt where there are none, or none
// is corrected.
std::optional<std::string> WarnOfFactors(const DepthAlignment& alignment);

}  // namespace raylift
