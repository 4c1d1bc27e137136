#include "lifting/alignment_text.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <string_view>
#include <vector>

#include "base/statistics.h"
#include <fmt/format.h>
#include <fmt/ranges.h>

namespace raylift {
namespace {

// Returns the factor in the middle of a map.
double LogFactorOf(const MapAlignment& map) { return UpperMedianOr(map.correction.log_factors, 0); }

std::string Names(std::span<const std::string_view> names) {
  constexpr size_t kMost = 5;
  const auto first = names.first(std::min(names.size(), kMost));
  return fmt::format("{}{}", fmt::join(first, ", "), names.size() > kMost ? ", ..." : "");
}

// Returns the maps whose factors are beyond three deviations of the others' and rest on less than
// half of the others' matches.
std::vector<const MapAlignment*> DoubtfulFactors(const DepthAlignment& alignment) {
  std::vector<double> log_factors, counts;
  for (const MapAlignment& map : alignment.maps) {
    if (!map.own_correction) continue;
    log_factors.push_back(LogFactorOf(map));
    counts.push_back(static_cast<double>(map.num_matches));
  }
  const double middle = UpperMedianOr(log_factors, 0);
  constexpr double kLeastSpread = 0.02;  // a factor this near to the others' is no matter
  const double spread = std::max(kLeastSpread, kSigmaPerMad * UpperDeviation(log_factors, middle));
  const double few = 0.5 * UpperMedianOr(std::move(counts), 0);
  std::vector<const MapAlignment*> doubtful;
  for (const MapAlignment& map : alignment.maps) {
    if (map.own_correction && static_cast<double>(map.num_matches) < few &&
        std::abs(LogFactorOf(map) - middle) > 3 * spread) {
      doubtful.push_back(&map);
    }
  }
  return doubtful;
}

}  // namespace

std::string Describe(const DepthAlignment& alignment) {
  if (alignment.mode == AlignMode::kOff) return "is left as read";
  return fmt::format("by {}: keypoints were {:.2f} px from their matches, now {:.2f} px (median)",
                     ToString(alignment.mode), alignment.median_before_px,
                     alignment.median_after_px);
}

std::string Describe(const ConfidenceWorth& worth) {
  if (!worth.tells()) {
    return fmt::format(
        "confidences tell nothing of the depth's noise and are dropped: it is {:.2g} % on the "
        "whole, "
        "by {} matches",
        100 * worth.common_sigma, worth.num_matches);
  }
  const ConfidenceWorth::Knot &least = worth.knots.front(), &most = worth.knots.back();
  return fmt::format(
      "confidences tell how noisy the depth is: {:.2g} % at {:.3g}, {:.2g} % at {:.3g}",
      100 * least.sigma, least.confidence, 100 * most.sigma, most.confidence);
}

std::optional<std::string> WarnOfFactors(const DepthAlignment& alignment) {
  if (alignment.mode == AlignMode::kOff) return std::nullopt;
  std::vector<std::string> parts;
  std::vector<std::string_view> untold;
  for (const MapAlignment& map : alignment.maps) {
    if (!map.own_correction) untold.push_back(map.reference);
  }
  if (!untold.empty()) {
    parts.push_back(fmt::format(
        "too few independent matches tell the depth's factor of {} of {} references, which take "
        "what is likely by the others ({:.3g}): {}",
        untold.size(), alignment.maps.size(), alignment.median_factor, Names(untold)));
  }
  for (const MapAlignment* map : DoubtfulFactors(alignment)) {
    parts.push_back(
        fmt::format("the depth of {} is corrected by {:.3g}, far from the others, on {} "
                    "matches",
                    map->reference, std::exp(LogFactorOf(*map)), map->num_matches));
  }
  if (parts.empty()) return std::nullopt;
  return fmt::format("{}", fmt::join(parts, "; "));
}

}  // namespace raylift
