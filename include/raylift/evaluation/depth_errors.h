// Errors of depth against the true depth, by the figures of merit of the depth estimation
// literature (Eigen, Puhrsch, Fergus 2014; KITTI). All of them look at pixels where both maps have
// depth; what one of them lacks is coverage, which is counted apart.
//
//   AbsRel |e - t| / t     SqRel (e - t)^2 / t     MAE |e - t|     means
//   RMSE, RMSE log         root mean squares of e - t and of d = ln e - ln t
//   SILog                  100 sqrt(mean d^2 - (mean d)^2), KITTI's: a common factor costs nothing
//   log10                  mean of |log10 e - log10 t| (Saxena, Sun, Ng 2009)
//   delta k                share of max(e / t, t / e) < 1.25^k
//
// Papers differ in how a map may be aligned with the truth beforehand: see DepthProtocol. The mean
// over images of an image's errors is what they print.
//
// Inputs are z-depths, row-major and of one size; 0 = none.

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/scene/image.h"

namespace raylift {

struct DepthErrors {
  size_t count = 0;  // pixels that both maps know
  double abs_rel = 0;
  double sq_rel = 0;  // scene units
  double rmse = 0;    // scene units
  double rmse_log = 0;
  double si_log = 0;
  std::array<double, 3> delta_percent = {0, 0, 0};
  double log10 = 0;
  double mae = 0;                  // scene units
  double median_signed_error = 0;  // e - t, scene units
};

// Returns nullopt where no pixel is known to both.
std::optional<DepthErrors> ComputeDepthErrors(std::span<const float> estimated,
                                              std::span<const float> truth);

// Aligns depth e with the truth: e becomes scale * e + shift, or 1 / e becomes scale / e + shift.
struct DepthFit {
  double scale = 1;
  double shift = 0;  // scene units; of inverse depth: 1 / scene units
  bool of_inverse = false;
};
enum class DepthFitKind {
  kMedian,         // the ratio of the medians (Zhou et al. 2017, section 4.1)
  kAffine,         // least squares of scale and shift, of depth (Yin et al. 2021, Ke et al. 2024)
  kInverseScale,   // least squares of the scale, of inverse depth
  kInverseAffine,  // of scale and shift, of inverse depth (Ranftl et al. 2020, eq. 4)
};
// Returns nullopt where too few pixels (1, or 2 different ones) are known to both.
std::optional<DepthFit> FitDepth(std::span<const float> estimated, std::span<const float> truth,
                                 DepthFitKind kind);

// The depths, in scene units, that an evaluation looks at: truth outside does not count, and
// aligned depth is clamped to it, as Eigen et al.'s code does (NYU: to 10 m, KITTI: 0.001 to 80 m).
struct DepthRange {
  double min = 0;
  double max = std::numeric_limits<double>::infinity();

  // Throws OptionError unless 0 <= min < max.
  void Validate() const;
  bool Contains(double z) const { return z >= min && z <= max; }
};

// Returns the aligned depths. Values that are not positive become the end of `range` that they lie
// beyond, or 0 where it has none. Depth beyond infinity is far: an inverse depth <= 0 becomes the
// largest.
std::vector<float> ApplyFit(std::span<const float> estimated, const DepthFit& fit,
                            const DepthRange& range = {});

// The ways in which the papers of depth networks align a map with the truth, image by image.
enum class DepthProtocol { kMetric, kScale, kAffine, kScaleInverse, kAffineInverse };
template <>
inline constexpr auto kEnumNames<DepthProtocol> = std::to_array<EnumName<DepthProtocol>>({
    {DepthProtocol::kMetric, "metric", "no alignment",
     "no alignment (Eigen et al. 2014, ZoeDepth, Metric3D)"},
    {DepthProtocol::kScale, "scale", "ratio of the medians",
     "ratio of the medians (Zhou et al. 2017, Monodepth2)"},
    {DepthProtocol::kAffine, "affine", "scale and shift of depth",
     "least squares of depth (LeReS, Marigold)"},
    {DepthProtocol::kScaleInverse, "scale-inverse", "scale of inverse depth",
     "least squares of inverse depth, without a shift"},
    {DepthProtocol::kAffineInverse, "affine-inverse", "scale and shift of inverse depth",
     "least squares of inverse depth (MiDaS, Depth Anything)"},
});
// Returns nullopt where nothing is left to compare, or nothing to align by.
std::optional<DepthErrors> ComputeDepthErrors(std::span<const float> estimated,
                                              std::span<const float> truth, DepthProtocol protocol,
                                              const DepthRange& range = {});

// Errors as a function of something that is known at each pixel: distance, incidence angle,
// distance to a depth edge. Bin i covers [edges[i], edges[i + 1]); what lies outside is not
// counted.
class BinnedDepthErrors {
 public:
  struct Bin {
    size_t count = 0;
    double sum_abs_rel = 0;
    double sum_abs = 0;         // scene units
    double sum_signed_rel = 0;  // (e - t) / t
    double AbsRel() const { return count > 0 ? sum_abs_rel / static_cast<double>(count) : 0; }
    double Mae() const { return count > 0 ? sum_abs / static_cast<double>(count) : 0; }
    double Bias() const { return count > 0 ? sum_signed_rel / static_cast<double>(count) : 0; }
  };

  BinnedDepthErrors() = default;
  explicit BinnedDepthErrors(std::vector<double> edges);  // ascending, at least two

  // Adds pixels. `at` holds the value that determines each pixel's bin; negative: unknown.
  void Add(std::span<const float> estimated, std::span<const float> truth,
           std::span<const float> at);
  void Add(const BinnedDepthErrors& other);  // of the same edges

  const std::vector<double>& edges() const { return edges_; }
  const std::vector<Bin>& bins() const { return bins_; }

 private:
  std::vector<double> edges_;
  std::vector<Bin> bins_;
};

// The angle between two fields of unit normals (x, y, z per pixel; 0, 0, 0 = none).
struct NormalErrors {
  size_t count = 0;
  double mean_deg = 0;
  double median_deg = 0;
  std::array<double, 3> within_percent = {0, 0, 0};  // of 11.25, 22.5 and 30 degrees
};
std::optional<NormalErrors> ComputeNormalErrors(std::span<const float> estimated,
                                                std::span<const float> truth);

// The share of the truth's pixels that a map covers, and how its holes are spread.
struct DepthCoverage {
  double covered_percent = 0;      // of the truth's pixels (of all pixels where there is no truth)
  double holes_per_megapixel = 0;  // connected holes (4-neighbors) of at least 4 pixels
  double invented_percent = 0;     // of all pixels: the map has depth where the truth has none
};
// Returns the coverage. `truth` may be empty: then no depth is invented.
DepthCoverage ComputeCoverage(std::span<const float> estimated, std::span<const float> truth,
                              int width_px);

// Accuracy and completeness of points against a surface (Knapitsch et al. 2017): the shares of the
// distances below a threshold, and their harmonic mean.
struct SurfaceScore {
  double threshold = 0;  // scene units
  double accuracy_percent = 0;
  double completeness_percent = 0;
  double f_percent = 0;
};
SurfaceScore ComputeSurfaceScore(std::span<const float> to_truth, std::span<const float> from_truth,
                                 double threshold);

// Depth edges, and how well those of one map lie on those of another: the depth boundary errors of
// Koch et al., "Evaluation of CNN-based Single-Image Depth Estimation Methods" (2018). Edges here
// are jumps of depth itself rather than Canny's on a normalized picture, so that they mean the same
// in every map.

// Returns 1 where a pixel's depth is smaller than that of one of its 4 neighbors by more than
// `min_jump` times its own; holes make no edges.
std::vector<uint8_t> FindDepthEdges(const DepthMap& map, double min_jump = 0.05);

// Returns the Euclidean distance in pixels of every pixel to the nearest set one, exactly
// (Felzenszwalb and Huttenlocher 2012); infinite where none is set. width_px divides mask.size().
std::vector<float> DistanceToSet(std::span<const uint8_t> mask, int width_px);

struct EdgeErrors {
  size_t num_true = 0;
  size_t num_estimated = 0;
  // Mean distance in pixels of estimated edges to true ones, of those closer than `max_px`; nullopt
  // where there are none.
  std::optional<double> accuracy_px;
  // Mean distance in pixels of true edges to estimated ones, each at most `max_px`; nullopt where
  // there are no true edges.
  std::optional<double> completeness_px;
  double spurious_percent = 0;  // of the estimated edges: `max_px` or farther from any true one
};
EdgeErrors ComputeEdgeErrors(std::span<const uint8_t> estimated, std::span<const uint8_t> truth,
                             int width_px, double max_px = 10);

}  // namespace raylift
