// Agreement of the depth of one image with that of the images that overlap it, without any
// truth: a pixel's point, seen from another image, should be at the depth that the source has
// there.
//
// With rho = ln(z of the point in the other image / z of the source there): |rho| small is
// consistent; rho well above 0 is a surface behind another, which is no contradiction; rho well
// below 0 is one: the other image looks through the point.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "raylift/comparison/depth_comparison.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Returns the images that see most of what an image sees (by the points of its pixels), among the
// nearest ones, best first; only those that see at least a fifth of it.
std::vector<std::vector<size_t>> FindOverlaps(const GeometrySource& source,
                                              std::span<const PosedImage> images, int max_overlaps,
                                              int threads);

ImageConsistency MeasureConsistency(const GeometrySource& source,
                                    std::span<const PosedImage> images, size_t image,
                                    std::span<const size_t> others);

// Returns ln of each image's scale relative to the mean of all, by least squares over the pairs;
// nullopt for an image without pairs.
std::vector<std::optional<double>> RelativeLogScales(std::span<const ImageConsistency> images);

// Returns ln of the factor by which all depths are too large, from the factor that makes the images
// agree best; nullopt where no factor is clearly better than the others. It needs views from
// different places: by pure rotations no scale can be told.
std::optional<double> CommonLogScale(std::span<const ImageConsistency> images);

}  // namespace raylift
