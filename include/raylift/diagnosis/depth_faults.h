// Names the faults of a source of depth by the trace that each kind of error leaves in r =
// ln(estimated / true).
//
//   scale            the median of r over everything       per-image scale   its spread over images
//   warp             the spread of the medians of r over blocks of an image
//   noise            differences of r between neighbors: additive where they fall as 1 / depth,
//                    multiplicative where they are the same at every depth
//   edges            outliers within 3 px of true depth edges that are none in the interior
//   flying pixels    pixels at a true edge between its two surfaces (FlyingPercent, cause_fits.h)
//   floaters         interior pixels well in front of the surface, with edges of their own
//   bubbles          the same, but smooth
//   quantization     few different values of depth
//   holes            the truth has depth where the source has none
//
// A cause that explains most of the errors together (depth_explanation.h) stands for those of its
// traces: a map that is turned is neither warped nor bad at edges.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/scene/image.h"

namespace raylift {

// The noise of pixels of similar depth.
struct NoiseLevel {
  double depth;
  double sigma;  // of r
};

// The traces of the errors in one image. Deviations are of r, robust (1.4826 times the median
// absolute deviation).
struct DepthDeviation {
  size_t count = 0;  // pixels that both maps know
  double log_scale = 0;
  double warp_sigma = 0;
  double noise_sigma = 0;
  std::vector<NoiseLevel> noise_levels;  // of a fifth of the pixels each
  double edge_outliers_percent = 0;
  double interior_outliers_percent = 0;
  double in_front_percent = 0;          // of the interior
  double edges_per_pixel_in_front = 0;  // that the truth does not have
};
// Measures the traces in one image. `to_true_edge_px` is the distance of each pixel to the nearest
// depth edge of the truth. Returns nullopt where the maps have fewer than 100 pixels in common.
std::optional<DepthDeviation> MeasureDeviation(const DepthMap& estimated, const DepthMap& truth,
                                               std::span<const float> to_true_edge_px);

// Returns the exponent k of sigma(r) ~ depth^k: about -1 for additive noise, 0 for multiplicative,
// 1 for that of stereo and structured light. nullopt where all depths are similar.
std::optional<double> NoiseExponent(std::span<const NoiseLevel> levels);

enum class DepthFault {
  kScale,
  kPerImageScale,
  kWarp,
  kNoise,  // neither of the next two, or not known which
  kAdditiveNoise,
  kMultiplicativeNoise,
  kEdges,
  kFlying,
  kFloaters,
  kBubbles,
  kQuantization,
  kHoles,
  // Causes of all of the error, found by fitting them (diagnosis/depth_explanation.h):
  kShift,
  kZoom,
  kLens,
  kRotation,
  kDisplacement,
  kTimeOffset,
  kOffset,
  kAffine,
  kInverseOffset,
  kClamp,
  kSmoothing,
  kFlipped,
  kRayLength,
  kDisparity,
  kPowerLaw,
  kCurve,
  kMedian,
  kFattening,
  kUnexplained,
};
template <>
inline constexpr auto kEnumNames<DepthFault> = std::to_array<EnumName<DepthFault>>({
    {DepthFault::kScale, "scale"},
    {DepthFault::kPerImageScale, "per-image scale"},
    {DepthFault::kWarp, "warp"},
    {DepthFault::kNoise, "noise"},
    {DepthFault::kAdditiveNoise, "additive noise"},
    {DepthFault::kMultiplicativeNoise, "multiplicative noise"},
    {DepthFault::kEdges, "edges"},
    {DepthFault::kFlying, "flying pixels"},
    {DepthFault::kFloaters, "floaters"},
    {DepthFault::kBubbles, "bubbles"},
    {DepthFault::kQuantization, "quantization"},
    {DepthFault::kHoles, "holes"},
    {DepthFault::kShift, "shift"},
    {DepthFault::kZoom, "zoom"},
    {DepthFault::kLens, "lens"},
    {DepthFault::kRotation, "rotation"},
    {DepthFault::kDisplacement, "displacement"},
    {DepthFault::kTimeOffset, "time offset"},
    {DepthFault::kOffset, "offset"},
    {DepthFault::kAffine, "affine"},
    {DepthFault::kInverseOffset, "inverse offset"},
    {DepthFault::kClamp, "clamp"},
    {DepthFault::kSmoothing, "smoothing"},
    {DepthFault::kFlipped, "flipped"},
    {DepthFault::kRayLength, "ray length"},
    {DepthFault::kDisparity, "disparity"},
    {DepthFault::kPowerLaw, "power law"},
    {DepthFault::kCurve, "depth curve"},
    {DepthFault::kMedian, "median"},
    {DepthFault::kFattening, "fattened foreground"},
    {DepthFault::kUnexplained, "not explained"},
});

struct Finding {
  DepthFault fault;
  double amount = 0;    // what the text says, as a number
  double severity = 0;  // in units of the least that is large enough to be reported
  std::string text;     // "scale: depth is 10.2 % too large"
};

// The measured traits of one source, over all images; nullopt where not measured.
struct SourceTraits {
  std::optional<double> log_scale;        // of the median image
  std::optional<double> log_scale_sigma;  // between images
  std::optional<double> warp_sigma;
  std::optional<double> noise_sigma;
  std::optional<double> noise_exponent;         // as NoiseExponent
  std::optional<double> noise_length;           // standard deviation of the depth, scene units
  std::optional<double> edge_outliers_percent;  // beyond those of the interior
  std::optional<double> in_front_percent;
  bool front_is_smooth = false;
  std::optional<double> relative_quantization;  // step over median depth
  std::optional<double> missing_percent;
};
// Returns the faults, the gravest first.
std::vector<Finding> FindFaults(const SourceTraits& traits);

// Returns 1.4826 times the median absolute deviation from the median; 0 for no values.
double RobustSigma(std::vector<double> values);

// The cause that explains best why depth maps differ from the truth, see
// diagnosis/depth_explanation.h.
struct DepthExplanation {
  // The mean |ln(estimated / true)| of the judged pixels, and the part of it that noise makes.
  double error = 0;
  double noise = 0;
  // The error is more than noise, with any cause or none.
  bool is_beyond_noise = false;
  // With kScale a factor for each view explains the error; other measures tell more of it. nullopt
  // where no cause is named.
  std::optional<DepthFault> cause;
  // The parameters of the cause. Shift: x, y in pixels of the image by which the map lies off.
  // Rotation: the vector in degrees, displacement: scene units, of cam_from_map_camera. Zoom: the
  // map's focal length over the true one. Lens: k in w(p) = c + (p - c) (1 + k (|p - c| / f)^2).
  // Time offset: frames. Offset: b, scene units. Affine, inverse offset: medians of a and b over
  // the views. Clamp: c. Quantization: step (scene units, or of inverse depth: 1 / scene units) and
  // bits of the largest value. Smoothing: standard deviation in pixels of the image. Flipped: 1 or
  // 0 for x, y. Ray length: 1 if lengths are read as z, -1 for the reverse. Disparity: medians of a
  // and b in a / true + b. Power law: medians of p and a in a true^p. Depth curve: true depth and
  // relative error, three times. Median: side of the window in pixels of the image; fattened
  // foreground: pixels of the image by which it reaches too far.
  std::vector<double> size;
  double explained_percent = 0;   // of what is beyond noise
  std::vector<DepthFault> alike;  // the best causes where they explain it alike; none is named
  // This share of the pixels at depth edges, in percent, lies between the two surfaces.
  double flying_percent = 0;
  std::string worst_place;  // "cam/1.jpg at 320, 240": of the largest errors
  std::string text;  // "shift: maps lie 2.0, -1.0 px off"; of causes that explain it alike: which
  double severity = 0;  // in units of the least that is large enough to be reported
};

}  // namespace raylift
