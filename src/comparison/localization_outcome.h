// What a comparison keeps of one way's result for one query, and its JSON.

#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/comparison/query_detail.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

struct LocalizationOutcome {
  std::optional<Rigid3> cam_from_world;  // none: not localized
  double inliers_2d3d = 0, inliers_2d2d = 0;
  QueryDetail detail;
};

std::string FormatOutcomes(std::span<const LocalizationOutcome> outcomes);
// None where the text is no such JSON, as of numbers that are not finite.
std::optional<std::vector<LocalizationOutcome>> ParseOutcomes(const std::string& text);

}  // namespace raylift
