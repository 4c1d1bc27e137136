#include "raylift/lifting/consistency_filter.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "lifting/fields.h"

#include "raylift/base/error.h"
#include "raylift/lifting/multi_view_errors.h"

namespace raylift {
namespace {

size_t CountAgreeing(std::span<const ViewError> views, double threshold_px) {
  return static_cast<size_t>(
      std::count_if(views.begin(), views.end(), [threshold_px](const ViewError& view) {
        return view.error_px && view.error_px->squaredNorm() <= threshold_px * threshold_px;
      }));
}

// Geometry whose depth adds up to this many deviations of the keypoints is left alone: over the
// queries of a real scene, at every density of references, meshes and sensor depth are below 2,
// monocular depth is above 3.5.
constexpr double kAccurateGeometry = 2.3;

// A point's expected error may be this many deviations of the keypoints.
constexpr double kTrustedError = 1.5;

FilterResult KeepAll(size_t num_points) {
  return {.keep = std::vector<bool>(num_points, true),
          .counts = {.consistent = num_points},
          .noise = std::nullopt};
}

bool IsAccurate(const MultiViewNoise& noise) {
  return noise.geometry_px <= kAccurateGeometry * noise.keypoints_px;
}

// An estimator can do without points where there are matches with two references.
bool SeveralReferences(std::span<const Match2D2D> matches) {
  return std::any_of(matches.begin(), matches.end(), [&](const Match2D2D& match) {
    return match.reference != matches.front().reference;
  });
}

void KeepTrusted(const MultiViewTrust& trust, FilterResult& result) {
  const double most_px = kTrustedError * trust.noise.keypoints_px;
  for (size_t i = 0; i < trust.points.size(); ++i) {
    const PointTrust& point = trust.points[i];
    result.keep[i] = !point.in_doubt && point.expected_error_px <= most_px;
    if (result.keep[i]) {
      ++result.counts.consistent;
    } else if (point.in_doubt) {
      ++result.counts.dropped_by_ratio;
    } else if (point.seen_by_others) {
      ++result.counts.dropped_by_error;
    } else {
      ++result.counts.dropped_by_views;
    }
  }
}

void KeepBest(const MultiViewTrust& trust, size_t count, FilterResult& result) {
  std::vector<double> errors;
  for (const PointTrust& point : trust.points) errors.push_back(point.expected_error_px);
  count = std::min(count, errors.size());
  std::nth_element(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(count) - 1,
                   errors.end());
  const double worst = errors[count - 1];
  result.counts = {};
  for (size_t i = 0; i < trust.points.size(); ++i) {
    result.keep[i] = trust.points[i].expected_error_px <= worst;
    ++(result.keep[i] ? result.counts.consistent : result.counts.dropped_by_error);
  }
}

}  // namespace

void ConsistencyThresholds::Validate() const { CheckRanges(ConstFieldsOf(*this)); }

FilterResult FilterPoints(std::span<const PosedImage> references,
                          std::span<const Match2D2D> matches_2d2d,
                          std::span<const Match2D3D> points, const FilterOptions& options) {
  switch (options.mode) {
    case FilterMode::kOff:
      return KeepAll(points.size());
    case FilterMode::kFixed:
      return FilterByConsistency(references, matches_2d2d, points, options.thresholds);
    case FilterMode::kAuto:
      return FilterByTrust(references, matches_2d2d, points, options.few_points, options.min_points,
                           options.scene_noise);
  }
  RAYLIFT_CHECK(false);
}

FilterResult FilterProblem(const FilterOptions& options, PoseProblem& problem) {
  FilterResult result =
      FilterPoints(problem.references, problem.matches_2d2d, problem.matches_2d3d, options);
  std::vector<Match2D3D> kept;
  for (size_t i = 0; i < problem.matches_2d3d.size(); ++i) {
    if (result.keep[i]) kept.push_back(problem.matches_2d3d[i]);
  }
  problem.matches_2d3d = std::move(kept);
  return result;
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

FilterResult FilterByTrust(std::span<const PosedImage> references,
                           std::span<const Match2D2D> matches_2d2d,
                           std::span<const Match2D3D> points, FewPoints few_points,
                           size_t min_points, const std::optional<MultiViewNoise>& scene_noise) {
  const auto trust = EstimateTrust(references, matches_2d2d, points);
  FilterResult result = KeepAll(points.size());
  if (!trust) {
    if (!scene_noise || IsAccurate(*scene_noise) || few_points == FewPoints::kKeepBest ||
        !SeveralReferences(matches_2d2d)) {
      return result;
    }
    // As the points of other queries that no other reference sees.
    return {.keep = std::vector<bool>(points.size(), false),
            .counts = {.dropped_by_views = points.size()},
            .noise = scene_noise};
  }
  result.noise = trust->noise;
  if (IsAccurate(scene_noise.value_or(trust->noise))) return result;
  result.counts = {};
  KeepTrusted(*trust, result);
  if (result.counts.consistent >= min_points) return result;
  switch (few_points) {
    case FewPoints::kDropAll:
      result.keep.assign(points.size(), false);
      result.counts.dropped_as_too_few = std::exchange(result.counts.consistent, 0);
      break;
    case FewPoints::kKeepBest:
      KeepBest(*trust, min_points, result);
      break;
  }
  return result;
}

}  // namespace raylift
