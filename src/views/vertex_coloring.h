// Colors for the vertices of a mesh that has none, from photographs with poses: so that a scan or
// an MVS mesh can be rendered as photographs see it, and be localized against alone.

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct VertexColoringOptions {
  // Photographs get factors, one per channel, with which common surfaces look alike.
  bool level_exposures = true;
  int threads = 0;
  std::function<void()> on_photograph = {};  // after each, from one thread
};

struct VertexColoring {
  std::vector<std::array<uint8_t, 3>> colors_rgb;
  // Counts the vertices that a photograph sees. The others have the colors of their neighbors, and
  // are gray where nothing that they are connected with is seen.
  size_t num_seen = 0;
  std::vector<Eigen::Vector3d> factors_rgb;  // per photograph; geometric mean 1
  // The distance between neighboring vertices in the photographs that see them best, and the width
  // of a pixel on the surface there (units of the mesh), medians over those seen: details that are
  // finer than the vertices are lost.
  double median_spacing_px = 0;
  double median_pixel_width = 0;
};

// Colors a mesh, which has the surface of `surface` and may be finer. A vertex takes what the
// photographs show that see it (by rays), the side of the surface that is seen better: those that
// resolve it best, in a patch as wide as its edges, weighed by how steeply they look at it; what
// disagrees with most of them is left out. The result is the same for any number of threads. Throws
// InputError where a photograph is missing below `folder` or has not its camera's size.
VertexColoring ColorVertices(const TriangleMesh& mesh, const RayCaster& surface,
                             std::span<const PosedImage> photographs,
                             const std::filesystem::path& folder,
                             const VertexColoringOptions& options = {});

}  // namespace raylift
