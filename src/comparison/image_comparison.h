// All sources in one image.

#pragma once

#include <span>
#include <vector>

#include "raylift/comparison/depth_comparison.h"

namespace raylift {

// What an image adds to the curves of one source.
struct ImageCurves {
  BinnedDepthErrors by_distance, by_incidence, by_edge_distance;
};

struct ImageResults {
  std::vector<ImageComparison> of_source;
  std::vector<ImageCurves> curves;
  std::vector<std::vector<Eigen::Vector3d>> points_of_source;  // where a mesh is the truth
};

// The errors of every source's view against the truth's, of depths within `range`.
ImageResults CompareImage(std::span<const ComparedSource> sources, const PosedImage& view,
                          std::span<const SourceView> views, std::optional<size_t> truth,
                          const DepthRange& range, const ImageCurves& empty_curves);

}  // namespace raylift
