#include "raylift/lifting/consistency_filter.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/statistics.h"
#include "lifting/fields.h"
#include "lifting/reference_matches.h"

#include "raylift/base/error.h"

namespace raylift {
namespace {

// The reprojection error of a point in another reference.
struct PointError : EpipolarError {
  size_t point;
};

std::vector<PointError> ErrorsInOthers(std::span<const PosedImage> references,
                                       const MultiViewErrors& errors,
                                       std::span<const Match2D3D> points) {
  std::vector<PointError> result;
  for (size_t i = 0; i < points.size(); ++i) {
    if (!points[i].reference) continue;
    const auto own = static_cast<size_t>(*points[i].reference);
    const Eigen::Vector3d ray_in_world =
        points[i].point_in_world - references[own].cam_from_world.OriginInSource();
    for (const ViewError& view : errors.ViewsOf(i)) {
      if (view.own || !view.error_px) continue;
      const PosedImage& other = references[static_cast<size_t>(view.reference)];
      const auto projection =
          other.camera.ImgFromCamWithJacobian(other.cam_from_world * points[i].point_in_world);
      const auto error = SplitByLine(
          *view.error_px, projection->jacobian * (other.cam_from_world.rotation * ray_in_world));
      if (error) result.push_back({*error, i});
    }
  }
  return result;
}

double MedianGain(const std::vector<PointError>& errors) {
  std::vector<double> gains;
  gains.reserve(errors.size());
  for (const PointError& e : errors) gains.push_back(e.gain_px);
  return UpperMedianInPlace(std::span(gains));
}

double OutlierRange(std::span<const PosedImage> references) {
  int width_px = 0;
  for (const PosedImage& reference : references) {
    width_px = std::max(width_px, reference.camera.width_px());
  }
  return 0.5 * width_px;
}

// The estimate of one point's log depth by its views, in units of the deviations.
struct DepthEvidence {
  double precision = 0;
  double weighted_sum = 0;
  size_t num_agreeing = 0;
  size_t num_views = 0;
};

// Returns the deviation of a point's log depth before any view: of all points, or its own, as far
// as its views do not contradict it.
double DeviationBefore(const Match2D3D& point, const DepthEvidence& views, double of_all) {
  constexpr double kGate = 3;  // deviations
  const double own = point.log_depth_sigma.value_or(0);
  if (!(own > 0) || !std::isfinite(own)) return of_all;
  if (!(views.precision > 0)) return own;
  const double error = views.weighted_sum / views.precision;
  const bool is_contradicted = error * error > kGate * kGate * (own * own + 1 / views.precision);
  return is_contradicted ? std::max(own, of_all) : own;
}

}  // namespace

std::optional<MultiViewTrust> EstimateTrust(std::span<const PosedImage> references,
                                            std::span<const Match2D2D> matches_2d2d,
                                            std::span<const Match2D3D> points) {
  constexpr size_t kFewest = 20;
  constexpr double kGate = 3;  // deviations
  const MultiViewErrors views(references, matches_2d2d, points);
  const std::vector<PointError> all = ErrorsInOthers(references, views, points);
  if (all.size() < kFewest) return std::nullopt;
  const double range_px = OutlierRange(references);

  std::vector<double> across;
  across.reserve(all.size());
  for (const PointError& e : all) across.push_back(e.across_px);
  const double keypoints_px = DeviationAmongOutliers(across, range_px);

  std::vector<DepthEvidence> evidence(points.size());
  std::vector<PointError> agreeing;
  for (const PointError& e : all) {
    ++evidence[e.point].num_views;
    if (std::abs(e.across_px) >= kGate * keypoints_px) continue;
    agreeing.push_back(e);
    DepthEvidence& point = evidence[e.point];
    ++point.num_agreeing;
    point.precision += e.gain_px * e.gain_px / (keypoints_px * keypoints_px);
    point.weighted_sum -= e.along_px * e.gain_px / (keypoints_px * keypoints_px);
  }
  if (agreeing.size() < kFewest) return std::nullopt;
  std::vector<double> along;
  along.reserve(agreeing.size());
  for (const PointError& e : agreeing) along.push_back(e.along_px);
  const double along_px = DeviationAmongOutliers(along, range_px);
  const double geometry_px =
      std::sqrt(std::max(along_px * along_px - keypoints_px * keypoints_px, 0.0));

  const double typical_gain_px = MedianGain(agreeing);
  // A hundredth of a pixel, so that perfect geometry has a finite precision.
  const double prior_deviation = std::max(geometry_px, 0.01) / typical_gain_px;
  MultiViewTrust trust{.noise = {keypoints_px, geometry_px, agreeing.size()}, .points = {}};
  for (size_t i = 0; i < points.size(); ++i) {
    const DepthEvidence& e = evidence[i];
    const double before = DeviationBefore(points[i], e, prior_deviation);
    const double precision = e.precision + 1 / (before * before);
    const double mean = e.weighted_sum / precision;
    trust.points.push_back(
        {.seen_by_others = e.num_agreeing > 0,
         .in_doubt = e.num_views > 0 && 2 * e.num_agreeing <= e.num_views,
         .expected_error_px = typical_gain_px * std::sqrt(mean * mean + 1 / precision)});
  }
  return trust;
}

std::optional<MultiViewNoise> PooledNoise(std::span<const MultiViewNoise> of_queries) {
  MultiViewNoise pooled;
  double keypoints_px2 = 0, geometry_px2 = 0;
  for (const MultiViewNoise& noise : of_queries) {
    const auto weight = static_cast<double>(noise.num_views);
    keypoints_px2 += weight * noise.keypoints_px * noise.keypoints_px;
    geometry_px2 += weight * noise.geometry_px * noise.geometry_px;
    pooled.num_views += noise.num_views;
  }
  if (pooled.num_views == 0) return std::nullopt;
  const auto total = static_cast<double>(pooled.num_views);
  pooled.keypoints_px = std::sqrt(keypoints_px2 / total);
  pooled.geometry_px = std::sqrt(geometry_px2 / total);
  return pooled;
}

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

// Points whose expected error is at most this many deviations of the keypoints are kept.
constexpr double kTrustedError = 1.5;

FilterResult KeepAll(size_t num_points) {
  return {.keep = std::vector<bool>(num_points, true),
          .counts = {.consistent = num_points},
          .noise = std::nullopt};
}

bool IsAccurate(const MultiViewNoise& noise) {
  return noise.geometry_px <= kAccurateGeometry * noise.keypoints_px;
}

// Returns whether there are matches with two references: an estimator can then do without points.
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

// Returns the points that the thresholds keep.
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

// Returns the points that kAuto keeps.
FilterResult FilterByTrust(std::span<const PosedImage> references,
                           std::span<const Match2D2D> matches_2d2d,
                           std::span<const Match2D3D> points, const FilterOptions& options) {
  const std::optional<MultiViewNoise>& known = options.multi_view_noise;
  const auto trust = EstimateTrust(references, matches_2d2d, points);
  FilterResult result = KeepAll(points.size());
  if (!trust) {
    if (!known || IsAccurate(*known) || options.few_points == FewPoints::kKeepBest ||
        !SeveralReferences(matches_2d2d)) {
      return result;
    }
    // Treats it as the points of other queries that no other reference sees.
    return {.keep = std::vector<bool>(points.size(), false),
            .counts = {.dropped_by_views = points.size()},
            .noise = known};
  }
  result.noise = trust->noise;
  if (IsAccurate(known.value_or(trust->noise))) return result;
  result.counts = {};
  KeepTrusted(*trust, result);
  if (result.counts.consistent >= options.min_points) return result;
  switch (options.few_points) {
    case FewPoints::kDropAll:
      result.keep.assign(points.size(), false);
      result.counts.dropped_as_too_few = std::exchange(result.counts.consistent, 0);
      break;
    case FewPoints::kKeepBest:
      KeepBest(*trust, options.min_points, result);
      break;
  }
  return result;
}

}  // namespace

std::vector<Field> FieldsOf(ConsistencyThresholds& thresholds) {
  return {
      {"filter_reprojection_px", thresholds.reprojection_px,
       "A reference agrees where the point lands this close to\n"
       "the matched keypoint",
       kPositive},
      {"filter_min_views", thresholds.min_views,
       "References that must agree, the point's own included", kAtLeastOne},
      {"filter_min_ratio", thresholds.min_ratio,
       "Share that must agree of the references that observe\n"
       "the keypoint; 0: any",
       kShare},
  };
}

std::vector<Field> FieldsOf(FilterOptions& options) {
  std::vector<Field> fields = {
      {"filter", options.mode,
       "Drop lifted points that too few references agree on:\n"
       "{}. fixed helps noisy geometry and hurts accurate\n"
       "geometry; auto leaves accurate geometry alone and needs none\n"
       "of the options below"},
  };
  const std::vector<Field> thresholds = FieldsOf(options.thresholds);
  fields.insert(fields.end(), thresholds.begin(), thresholds.end());
  return fields;
}

std::vector<Field> FieldsOf(FilterCounts& counts) {
  return {
      {"consistent", counts.consistent, "Points that the filter keeps"},
      {"dropped_by_views", counts.dropped_by_views, "Points that too few references see"},
      {"dropped_by_ratio", counts.dropped_by_ratio, "Points that too many contradict"},
      {"dropped_by_error", counts.dropped_by_error, "Points too far off, by their views"},
      {"dropped_as_too_few", counts.dropped_as_too_few,
       "Consistent points, of which too few remain"},
  };
}

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
      return FilterByTrust(references, matches_2d2d, points, options);
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

}  // namespace raylift
