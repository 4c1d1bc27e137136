#include "raylift/lifting/consistency_filter.h"

#include <array>
#include <cmath>
#include <string>
#include <utility>

#include "raylift/base/error.h"
#include "raylift/lifting/multi_view_errors.h"

namespace raylift {
namespace {

constexpr std::array<std::pair<FilterMode, std::string_view>, 2> kModeNames = {{
    {FilterMode::kOff, "off"},
    {FilterMode::kFixed, "fixed"},
}};

size_t CountAgreeing(std::span<const ViewError> views, double threshold_px) {
  return static_cast<size_t>(
      std::count_if(views.begin(), views.end(), [threshold_px](const ViewError& view) {
        return view.error_px && view.error_px->squaredNorm() <= threshold_px * threshold_px;
      }));
}

}  // namespace

std::string_view ToString(FilterMode mode) {
  for (const auto& [value, name] : kModeNames) {
    if (value == mode) return name;
  }
  return {};
}

std::optional<FilterMode> FilterModeFromName(std::string_view name) {
  for (const auto& [value, known] : kModeNames) {
    if (known == name) return value;
  }
  return std::nullopt;
}

void ConsistencyThresholds::Validate() const {
  if (!(reprojection_px > 0) || !std::isfinite(reprojection_px)) {
    throw OptionError("--filter-reprojection-px", std::to_string(reprojection_px),
                      "must be positive");
  }
  if (min_views < 1) {
    throw OptionError("--filter-min-views", std::to_string(min_views), "must be at least 1");
  }
  if (!(min_ratio >= 0 && min_ratio <= 1)) {
    throw OptionError("--filter-min-ratio", std::to_string(min_ratio), "must be between 0 and 1");
  }
}

FilterResult FilterPoints(std::span<const PosedImage> references,
                          std::span<const Match2D2D> matches_2d2d,
                          std::span<const Match2D3D> points, const FilterOptions& options) {
  switch (options.mode) {
    case FilterMode::kOff:
      return {.keep = std::vector<bool>(points.size(), true),
              .counts = {.consistent = points.size()}};
    case FilterMode::kFixed:
      return FilterByConsistency(references, matches_2d2d, points, options.thresholds);
  }
  RAYLIFT_CHECK(false);
}

FilterResult FilterByConsistency(std::span<const PosedImage> references,
                                 std::span<const Match2D2D> matches_2d2d,
                                 std::span<const Match2D3D> points,
                                 const ConsistencyThresholds& thresholds) {
  const MultiViewErrors errors(references, matches_2d2d, points);
  // A ratio such as 0.8 of 5 views must not ask for a fifth view by rounding.
  constexpr double kRounding = 1e-9;
  FilterResult result;
  for (size_t i = 0; i < errors.num_points(); ++i) {
    const auto views = errors.ViewsOf(i);
    const size_t agreeing = CountAgreeing(views, thresholds.reprojection_px);
    const double needed = thresholds.min_ratio * static_cast<double>(views.size()) - kRounding;
    const bool enough_views = agreeing >= static_cast<size_t>(thresholds.min_views);
    const bool enough_ratio = static_cast<double>(agreeing) >= needed;
    result.keep.push_back(enough_views && enough_ratio);
    if (!enough_views) {
      ++result.counts.dropped_by_views;
    } else if (!enough_ratio) {
      ++result.counts.dropped_by_ratio;
    } else {
      ++result.counts.consistent;
    }
  }
  return result;
}

}  // namespace raylift
