#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <span>

#include "features/dot_products.h"
#include <Eigen/LU>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/features/local_features.h"

namespace raylift {
namespace {

// The number of the query's features that are taken at once: their products with a reference of
// some thousand features stay in the second-level cache.
constexpr Eigen::Index kRowsOfBlock = 32;
// The second nearest must lie farther from the nearest than this: the same place found again, at
// another scale or orientation, does not make a match ambiguous (1 to 2 % more correct matches at
// the same share of wrong ones).
constexpr double kSamePlacePx = 2;

struct Candidate {
  int reference_index;
  int32_t dot;
  bool passes_ratio_test;
};

// Returns whether a feature of the reference, at another place than the best one, is so near to the
// query's that d_best < ratio d_second fails, with d^2 = 2 - 2 dot.
bool IsAmbiguous(std::span<const int32_t> dots, size_t best, const Features& reference,
                 const MatchOptions& options) {
  if (options.max_ratio >= 1) {
    return false;
  }
  constexpr auto kOne = static_cast<double>(kQuantizedOneSquared);
  const double largest_second_dot =
      kOne - std::max(0.0, kOne - dots[best]) / (options.max_ratio * options.max_ratio);
  const Eigen::Vector2d best_px = reference.keypoints_px[best];
  for (size_t j = 0; j < dots.size(); ++j) {
    if (dots[j] >= largest_second_dot && j != best &&
        (reference.keypoints_px[j] - best_px).squaredNorm() > kSamePlacePx * kSamePlacePx) {
      return true;
    }
  }
  return false;
}

// Keeps the best of the matches that join the same two pixels, as places with several orientations
// have several: the estimator would count them as independent.
std::vector<FeatureMatch> OnePerPixelPair(const std::vector<FeatureMatch>& matches,
                                          const Features& query, const Features& reference) {
  using PixelPair = std::array<double, 4>;
  std::map<PixelPair, size_t> place_of;
  std::vector<FeatureMatch> kept;
  for (const FeatureMatch& match : matches) {
    const Eigen::Vector2d& q = query.keypoints_px[match.query_index];
    const Eigen::Vector2d& r = reference.keypoints_px[match.reference_index];
    const auto [place, is_new] =
        place_of.try_emplace(PixelPair{q.x(), q.y(), r.x(), r.y()}, kept.size());
    if (is_new) {
      kept.push_back(match);
    } else if (match.score > kept[place->second].score) {
      kept[place->second] = match;
    }
  }
  std::sort(kept.begin(), kept.end(), [](const FeatureMatch& a, const FeatureMatch& b) {
    return a.query_index < b.query_index;
  });
  return kept;
}

void CheckDescriptors(const Features& query, const Features& reference) {
  for (const Features* features : {&query, &reference}) {
    RAYLIFT_CHECK_EQ(static_cast<size_t>(features->descriptors.cols()),
                     features->keypoints_px.size());
  }
  if (query.descriptors.rows() != reference.descriptors.rows()) {
    throw InputError(fmt::format("the query's descriptors have {} values, the reference's {}",
                                 query.descriptors.rows(), reference.descriptors.rows()));
  }
}

// Half an axis of a region, in standard deviations.
constexpr double kSigmasOfRegion = 3;
// The probability of a match that chance makes in a region.
constexpr double kChance = 0.05;

// Returns the query's features in the region.
std::vector<size_t> InRegion(const SearchRegion& region, const Features& query) {
  const Eigen::Matrix2d information = region.covariance_px2.inverse();
  std::vector<size_t> inside;
  for (size_t j = 0; j < query.keypoints_px.size(); ++j) {
    const Eigen::Vector2d off = query.keypoints_px[j] - region.center_px;
    if (off.dot(information * off) < kSigmasOfRegion * kSigmasOfRegion) inside.push_back(j);
  }
  return inside;
}

// Returns the nearest of the features in a region, which chance would not have there.
std::optional<size_t> NearestWithin(std::span<const size_t> inside, std::span<const int32_t> dots) {
  const double share = static_cast<double>(inside.size()) / static_cast<double>(dots.size());
  if (inside.empty() || share >= kChance) return std::nullopt;
  const size_t best = *std::ranges::max_element(inside, {}, [&](size_t j) { return dots[j]; });
  const auto nearer = std::ranges::count_if(dots, [&](int32_t dot) { return dot > dots[best]; });
  const double chance = 1 - std::pow(1 - share, static_cast<double>(nearer + 1));
  return chance < kChance ? std::optional(best) : std::nullopt;
}

float ScoreOf(int32_t dot) {
  return static_cast<float>(0.5 * (1 + dot / static_cast<double>(kQuantizedOneSquared)));
}

}  // namespace

double SearchRegion::AreaPx2() const {
  return std::numbers::pi * kSigmasOfRegion * kSigmasOfRegion *
         std::sqrt(std::max(0.0, covariance_px2.determinant()));
}

std::vector<FeatureMatch> MatchMutualNearest(const Features& query, const Features& reference,
                                             const MatchOptions& options) {
  if (query.descriptors.size() == 0 || reference.descriptors.size() == 0) {
    return {};
  }
  CheckDescriptors(query, reference);
  const QuantizedDescriptors rows = QuantizeDirections(query.descriptors);
  const DotColumns columns(QuantizeDirections(reference.descriptors));
  const auto num_columns = static_cast<size_t>(reference.descriptors.cols());

  std::vector<Candidate> candidates;
  candidates.reserve(rows.count);
  std::vector<int32_t> column_best(num_columns, std::numeric_limits<int32_t>::min());
  std::vector<int32_t> column_best_row(num_columns, 0);
  std::vector<int32_t> dots(kRowsOfBlock * columns.stride());
  for (Eigen::Index first = 0; first < rows.count; first += kRowsOfBlock) {
    const Eigen::Index num_rows = std::min(kRowsOfBlock, rows.count - first);
    columns.ComputeDots(rows, first, num_rows, dots);
    for (Eigen::Index i = 0; i < num_rows; ++i) {
      const std::span<const int32_t> row(dots.data() + i * columns.stride(), num_columns);
      const size_t best = IndexOfMax(row);
      candidates.push_back(
          {static_cast<int>(best), row[best], !IsAmbiguous(row, best, reference, options)});
      UpdateColumnBest(row, static_cast<int32_t>(first + i), column_best, column_best_row);
    }
  }

  std::vector<FeatureMatch> matches;
  for (int i = 0; i < static_cast<int>(candidates.size()); ++i) {
    const Candidate& candidate = candidates[i];
    if (candidate.passes_ratio_test && column_best_row[candidate.reference_index] == i) {
      matches.push_back({i, candidate.reference_index, ScoreOf(candidate.dot)});
    }
  }
  return OnePerPixelPair(matches, query, reference);
}

std::vector<FeatureMatch> MatchWithin(std::span<const std::optional<SearchRegion>> regions,
                                      const Features& query, const Features& reference,
                                      const MatchOptions& options) {
  RAYLIFT_CHECK_EQ(regions.size(), reference.keypoints_px.size());
  std::map<int, FeatureMatch> of_query;
  const auto add = [&](const FeatureMatch& match) {
    const auto [place, is_new] = of_query.try_emplace(match.query_index, match);
    if (!is_new && match.score > place->second.score) place->second = match;
  };
  std::vector<FeatureMatch> anywhere = MatchMutualNearest(query, reference, options);
  if (query.descriptors.size() == 0 || reference.descriptors.size() == 0) return anywhere;
  std::vector<std::optional<size_t>> matched(regions.size());  // with what is the nearest of all
  for (const FeatureMatch& match : anywhere) {
    matched[static_cast<size_t>(match.reference_index)] = static_cast<size_t>(match.query_index);
  }
  const QuantizedDescriptors rows = QuantizeDirections(reference.descriptors);
  const DotColumns columns(QuantizeDirections(query.descriptors));
  const size_t num_columns = query.keypoints_px.size();
  std::vector<int32_t> dots(kRowsOfBlock * columns.stride());
  for (Eigen::Index first = 0; first < rows.count; first += kRowsOfBlock) {
    const Eigen::Index num_rows = std::min(kRowsOfBlock, rows.count - first);
    columns.ComputeDots(rows, first, num_rows, dots);
    for (Eigen::Index i = 0; i < num_rows; ++i) {
      const auto index = static_cast<size_t>(first + i);
      if (!regions[index]) continue;
      const std::span<const int32_t> row(dots.data() + i * columns.stride(), num_columns);
      const std::vector<size_t> inside = InRegion(*regions[index], query);
      std::optional<size_t> found = NearestWithin(inside, row);
      if (matched[index] && std::ranges::binary_search(inside, *matched[index])) {
        found = matched[index];
      }
      if (!found) continue;
      add({static_cast<int>(*found), static_cast<int>(index), ScoreOf(row[*found])});
    }
  }
  std::vector<FeatureMatch> matches;
  for (const auto& [query_index, match] : of_query) matches.push_back(match);
  return OnePerPixelPair(matches, query, reference);
}

}  // namespace raylift
