// How well the depth of one image agrees with that of the images that overlap it, without any
// truth: a pixel's point, seen from another image, should be at the depth that the source has
// there.
//
// With rho = ln(z of the point in the other image / z of the source there): |rho| small is
// consistent; rho well above 0 is a surface behind another, which is no contradiction; rho well
// below 0 is one: the other image looks through the point.

#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// The images that see most of what an image sees (by the points of its pixels), among the nearest
// ones, best first; only those that see at least a fifth of it.
std::vector<std::vector<size_t>> FindOverlaps(const GeometrySource& source,
                                              std::span<const PosedImage> images, int max_overlaps,
                                              int threads);

struct ConsistencyOptions {
  int samples = 800;  // pixels per image, on a grid
  // Factors that are tried on all depths at once, to find the common scale.
  double max_log_scale = 0.24;
  int scale_steps = 13;
};

struct PairConsistency {
  size_t other = 0;
  size_t count = 0;
  double median_rho = 0;  // of |rho| < 0.25: which of the two images has the larger scale
};

struct ImageConsistency {
  size_t count = 0;                                  // samples that fall on depth in another image
  std::array<double, 3> within_percent = {0, 0, 0};  // |rho| below 1, 2 and 5 %
  double contradicted_percent = 0;                   // rho < -5 %
  double behind_percent = 0;                         // rho > 5 %
  double median_abs_rho = 0;
  std::vector<PairConsistency> pairs;
  std::vector<double> cost_of_scale;  // sum of min(|rho|, 10 %) per factor tried
};

ImageConsistency MeasureConsistency(const GeometrySource& source,
                                    std::span<const PosedImage> images, size_t image,
                                    std::span<const size_t> others,
                                    const ConsistencyOptions& options);

// ln of each image's scale relative to the mean of all, by least squares over the pairs; none for
// an image without pairs.
std::vector<std::optional<double>> RelativeLogScales(std::span<const ImageConsistency> images);

// ln of the factor by which all depths are too large, from the factor that makes the images agree
// best; none where no factor is clearly better than the others. It needs views from different
// places: by pure rotations no scale can be told.
std::optional<double> CommonLogScale(std::span<const ImageConsistency> images,
                                     const ConsistencyOptions& options);

}  // namespace raylift
