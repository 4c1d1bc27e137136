// Keeps the lifted points that several references agree on (Panek et al., Sec. 4): a point counts
// the references, among those that hold a match of its query keypoint, in which it lands close to
// the matched keypoint, and is dropped where they are too few. This helps noisy geometry a lot and
// hurts accurate geometry, so it is off unless asked for.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// The consistency filter without thresholds: each lifted point is rated by the multi-view errors
// alone.
//
// The error of a point in another reference has a part across the epipolar line, which only the
// keypoints' noise causes, and a part along it, which wrong depth adds to. Their distributions over
// all points of the query give the deviations s_n (keypoints) and s_a (along), and what the depth
// adds, s_g^2 = s_a^2 - s_n^2. Where s_g is of the order of s_n, the geometry is as good as the
// matches and all points are kept.
//
// Else the error in log depth of each point is estimated from its views: a view in which one unit
// of it moves the projection by g px along the line measures it as -a / g with deviation s_n / g;
// before any view it is 0 with deviation s_g / G, G being the median of g, or with the deviation
// that the point carries (log_depth_sigma), unless its views contradict that by three deviations.
// The point's expected error in a further view, G sqrt(mean^2 + variance), must be of the order of
// s_n. So a point that no other reference sees well enough is as good as the geometry is on the
// whole.
//
// All queries of a scene together tell better than the few views of one query whether its geometry
// is accurate.

// Standard deviations in pixels of a reference.
struct MultiViewNoise {
  double keypoints_px = 0;
  double geometry_px = 0;  // what wrong depth adds along epipolar lines, at a typical baseline
  size_t num_views = 0;    // that say so

  bool operator==(const MultiViewNoise&) const = default;
};

struct PointTrust {
  bool seen_by_others = false;  // in a view that agrees across the epipolar line
  bool in_doubt = false;        // at least half of the views disagree there: a wrong match
  double expected_error_px = 0;
};

struct MultiViewTrust {
  MultiViewNoise noise;
  std::vector<PointTrust> points;
};

// Returns nullopt where too few views of several references tell the noise.
std::optional<MultiViewTrust> EstimateTrust(std::span<const PosedImage> references,
                                            std::span<const Match2D2D> matches_2d2d,
                                            std::span<const Match2D3D> points);

// Returns the noise of a scene from that of its queries, over all of their views; nullopt for an
// empty list.
std::optional<MultiViewNoise> PooledNoise(std::span<const MultiViewNoise> of_queries);

enum class FilterMode {
  kOff,
  kFixed,  // the paper's, with the thresholds of the options
  kAuto,   // by each point's expected error, see above; leaves accurate geometry alone
};
template <>
inline constexpr auto kEnumNames<FilterMode> = std::to_array<EnumName<FilterMode>>({
    {FilterMode::kOff, "off"},
    {FilterMode::kFixed, "fixed"},
    {FilterMode::kAuto, "auto"},
});

// "all the retrieved reference images containing the corresponding 2D point" (the paper) include
// the one that the point was lifted from, so it counts as well, on both sides: with min_views 3 two
// others must agree, and the ratio of a keypoint seen by one reference alone is 1.
struct ConsistencyThresholds {
  double reprojection_px = 4;  // the paper's "RE thr."
  int min_views = 3;           // "in. thr."
  double min_ratio = 0.8;      // "rel. thr.", of the references that observe the keypoint; 0: none

  bool operator==(const ConsistencyThresholds&) const = default;

  // Throws OptionError for a value out of its range.
  void Validate() const;
};

// States what kAuto does where it would keep fewer than `min_points`.
enum class FewPoints {
  kDropAll,   // a handful of noisy points only disturbs an estimator that can do without
  kKeepBest,  // the best `min_points`, for an estimator that has nothing else
};

struct FilterOptions {
  FilterMode mode = FilterMode::kOff;
  ConsistencyThresholds thresholds = {};  // of kFixed
  FewPoints few_points = FewPoints::kDropAll;
  size_t min_points = 30;
  // For kAuto: the noise that all queries of the scene show, which tells better than one query's
  // views whether the geometry is accurate.
  std::optional<MultiViewNoise> multi_view_noise = std::nullopt;

  bool operator==(const FilterOptions&) const = default;
};

struct FilterCounts {
  size_t consistent = 0;
  size_t dropped_by_views = 0;
  size_t dropped_by_ratio = 0;  // of those that enough views agree on
  // kAuto counts here the points whose views show too large an error, in dropped_by_views those
  // that no other reference sees, and in dropped_by_ratio those that half of the others contradict.
  size_t dropped_by_error = 0;
  size_t dropped_as_too_few = 0;  // consistent, but too few remained
};

struct FilterResult {
  std::vector<bool> keep;  // one per point
  FilterCounts counts;
  std::optional<MultiViewNoise> noise;  // that kAuto found
};

// Returns which points the options keep: all of them where the filter is off.
FilterResult FilterPoints(std::span<const PosedImage> references,
                          std::span<const Match2D2D> matches_2d2d,
                          std::span<const Match2D3D> points, const FilterOptions& options);

// Drops the 2D-3D matches of a problem that the options do not keep.
FilterResult FilterProblem(const FilterOptions& options, PoseProblem& problem);

}  // namespace raylift
