// Where depth jumps, and how well the jumps of one map lie on those of another: the depth boundary
// errors of Koch et al., "Evaluation of CNN-based Single-Image Depth Estimation Methods" (2018).
// Edges here are jumps of depth itself rather than Canny's on a normalized picture, so that they
// mean the same in every map.

#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "raylift/scene/image.h"

namespace raylift {

// 1 where a pixel's depth is smaller than that of one of its 4 neighbors by more than `min_jump`
// times its own; holes make no edges.
std::vector<uint8_t> FindDepthEdges(const DepthMap& map, double min_jump = 0.05);

// The Euclidean distance in pixels of every pixel to the nearest set one, exactly (Felzenszwalb and
// Huttenlocher 2012); infinite where none is set. width_px divides mask.size().
std::vector<float> DistanceToSet(std::span<const uint8_t> mask, int width_px);

struct EdgeErrors {
  size_t num_true = 0;
  size_t num_estimated = 0;
  // Mean distance in pixels of estimated edges to true ones, of those closer than `max_px`; none
  // where there are none.
  std::optional<double> accuracy_px;
  // Mean distance of true edges to estimated ones, no distance counting more than `max_px`; none
  // where there are no true edges.
  std::optional<double> completeness_px;
  double spurious_percent = 0;  // of the estimated edges: `max_px` or farther from any true one
};
EdgeErrors ComputeEdgeErrors(std::span<const uint8_t> estimated, std::span<const uint8_t> truth,
                             int width_px, double max_px = 10);

}  // namespace raylift
