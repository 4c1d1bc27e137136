// Matches between references, from the matches of queries: where a query keypoint is matched with
// several references, the matched keypoints show the same point. They tell how well a source of
// geometry fits the references' poses without any ground truth.

#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/base/enum_names.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// Indices refer to a list of references that comes with the matches.
struct ReferenceMatch {
  int reference_a = 0;
  int reference_b = 0;  // another
  Eigen::Vector2d a_px;
  Eigen::Vector2d b_px;
};

// Returns all pairs of keypoints of different references that are matched with one query keypoint,
// each pair once.
std::vector<ReferenceMatch> TransitiveMatches(std::span<const Match2D2D> matches);

// Corrects the depth of geometry per reference, for depth maps that do not agree with each other
// (monocular depth: each map has a scale and a slow drift of its own).

// z becomes z * exp(log_factor(pixel)) + shift. The log factor is bilinear between the nodes of a
// grid spread over the image from corner to corner, row by row; a 1 x 1 grid is one factor.
struct DepthCorrection {
  int columns = 1;
  int rows = 1;
  std::vector<double> log_factors = {0};
  double shift = 0;  // scene units

  double Correct(double z, const Camera& camera, const Eigen::Vector2d& pixel) const;
};

// The nodes whose weighted sum is a grid's value at a pixel. Pixels outside the image take the
// border's value. A node may stand twice, with weight 0.
struct GridWeight {
  size_t node;
  double weight;
};
std::array<GridWeight, 4> GridWeights(int columns, int rows, const Camera& camera,
                                      const Eigen::Vector2d& pixel);

// Moves the points of a source along the rays of their reference pixels. References without a
// correction are left as they are; points whose corrected depth is not positive are dropped.
class AlignedSource final : public GeometrySource {
 public:
  AlignedSource(std::shared_ptr<const GeometrySource> source,
                std::map<std::string, DepthCorrection> correction_of_reference);

  std::string Description() const override;
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override;

 private:
  std::shared_ptr<const GeometrySource> source_;
  std::map<std::string, DepthCorrection> corrections_;
};

// Makes the depth of many maps consistent without ground truth: matches between references whose
// poses are known give the depth of keypoints by triangulation, and each map is corrected so that
// its keypoints project onto their matches in the other references. Maps do not depend on each
// other, as only the matches in the other images are used, never the other maps' depth.

enum class AlignMode {
  kOff,
  kScale,   // one factor per map
  kAffine,  // factor and shift
  kGrid,    // factors on a coarse grid, bilinear between (low frequencies in log depth)
  // Takes the first of these modes that predicts held-out matches as well as any.
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

// The result of the alignment for one map.
struct MapAlignment {
  std::string reference;
  DepthCorrection correction;
  size_t num_matches = 0;       // independent ones, that the correction rests on
  bool own_correction = false;  // else what its matches and the others' factors make likely
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

// Fits the corrections. The result does not depend on the number of threads.
DepthAlignment AlignDepth(const GeometrySource& source, std::span<const PosedImage> references,
                          std::span<const ReferenceMatch> matches, AlignMode mode, int threads);

}  // namespace raylift
