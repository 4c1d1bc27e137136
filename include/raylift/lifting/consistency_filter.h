// Keeps the lifted points that several references agree on (Panek et al., Sec. 4): a point counts
// the references, among those that hold a match of its query keypoint, in which it lands close to
// the matched keypoint, and is dropped where they are too few. This helps noisy geometry a lot and
// hurts accurate geometry, so it is off unless asked for.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/lifting/auto_filter.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

enum class FilterMode {
  kOff,
  kFixed,  // the paper's, with the thresholds of the options
  kAuto,   // by each point's expected error, see auto_filter.h; leaves accurate geometry alone
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

// What kAuto does where it would keep fewer than `min_points`.
enum class FewPoints {
  kDropAll,   // a handful of noisy points only disturbs an estimator that can do without
  kKeepBest,  // the best `min_points`, for an estimator that has nothing else
};

struct FilterOptions {
  FilterMode mode = FilterMode::kOff;
  ConsistencyThresholds thresholds;  // of kFixed
  FewPoints few_points = FewPoints::kDropAll;
  size_t min_points = 30;
  // Of kAuto: what the scene's queries show together, which says better than one query's views
  // whether the geometry is accurate.
  std::optional<MultiViewNoise> scene_noise = std::nullopt;

  bool operator==(const FilterOptions&) const = default;
};

struct FilterCounts {
  size_t consistent = 0;
  size_t dropped_by_views = 0;
  size_t dropped_by_ratio = 0;  // of those that enough views agree on
  // kAuto counts here what its views say is too far off; as dropped by views what no other
  // reference sees, as dropped by ratio what half of the others contradict.
  size_t dropped_by_error = 0;
  size_t dropped_as_too_few = 0;  // consistent, but too few remained
};

struct FilterResult {
  std::vector<bool> keep;  // one per point
  FilterCounts counts;
  std::optional<MultiViewNoise> noise;  // that kAuto found
};

// The points that the options keep: all of them where the filter is off.
FilterResult FilterPoints(std::span<const PosedImage> references,
                          std::span<const Match2D2D> matches_2d2d,
                          std::span<const Match2D3D> points, const FilterOptions& options);

// Drops the 2D-3D matches of a problem that the options do not keep.
FilterResult FilterProblem(const FilterOptions& options, PoseProblem& problem);

// The points that the thresholds keep.
FilterResult FilterByConsistency(std::span<const PosedImage> references,
                                 std::span<const Match2D2D> matches_2d2d,
                                 std::span<const Match2D3D> points,
                                 const ConsistencyThresholds& thresholds);

// The points that kAuto keeps.
FilterResult FilterByTrust(std::span<const PosedImage> references,
                           std::span<const Match2D2D> matches_2d2d,
                           std::span<const Match2D3D> points, FewPoints few_points,
                           size_t min_points,
                           const std::optional<MultiViewNoise>& scene_noise = std::nullopt);

}  // namespace raylift
