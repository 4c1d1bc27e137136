// Makes the depth of many maps consistent without ground truth: matches between references whose
// poses are known say by triangulation how deep a keypoint is, and each map is corrected so that
// its keypoints project onto their matches in the other references. Maps do not depend on each
// other, as only the matches in the other images are used, never the other maps' depth.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/lifting/aligned_source.h"
#include "raylift/lifting/reference_matches.h"

namespace raylift {

enum class AlignMode {
  kOff,
  kScale,   // one factor per map
  kAffine,  // factor and shift
  kGrid,    // factors on a coarse grid, bilinear between (low frequencies in log depth)
  // The first of these that predicts matches which it was not fitted to as well as any.
  kAuto,
};
template <>
inline constexpr auto kEnumNames<AlignMode> = std::to_array<EnumName<AlignMode>>({
    {AlignMode::kOff, "off"},
    {AlignMode::kScale, "scale"},
    {AlignMode::kAffine, "affine"},
    {AlignMode::kGrid, "grid"},
    {AlignMode::kAuto, "auto"},
});

struct AlignOptions {
  AlignMode mode = AlignMode::kOff;
  int grid_columns = 5;
  int grid_rows = 4;
  // Matches farther than this from the epipolar line are wrong and not used.
  double epipolar_threshold_px = 3;
  // Residuals are weighed by Cauchy's loss of this width.
  double loss_width_px = 2;
  // A map with fewer matches takes the median factor of the others.
  size_t min_matches = 10;
};

// What the alignment did to one map.
struct MapAlignment {
  std::string reference;
  DepthCorrection correction;
  size_t num_matches = 0;       // that the correction rests on
  bool own_correction = false;  // else the others' median factor
  double median_before_px = 0;  // distance of projected keypoints from their matches
  double median_after_px = 0;
};

struct DepthAlignment {
  AlignMode mode = AlignMode::kOff;  // never kAuto: what it came to
  std::vector<MapAlignment> maps;    // one per reference
  double median_factor = 1;          // over the maps with a correction of their own
  double median_before_px = 0;       // over all matches
  double median_after_px = 0;

  std::map<std::string, DepthCorrection> Corrections() const;
};

// Results do not depend on the number of threads.
DepthAlignment AlignDepth(const GeometrySource& source, std::span<const PosedImage> references,
                          std::span<const ReferenceMatch> matches, const AlignOptions& options,
                          int threads);

}  // namespace raylift
