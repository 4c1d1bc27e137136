// The geometry that many views see, as one mesh: a mean of truncated signed distances (Curless and
// Levoy 1996) on a sparse grid. Each view adds, at the grid's points about the surface that it
// sees, how far they are before it or behind it, weighed by how sure that is; and what it looks
// through is free, whatever other views put there. The surface is where the mean is zero.
//
// The distance of a point is that from the plane that its pixel shows, not along the pixel's ray,
// which is longer wherever the surface is slanted: walls that are seen from several sides then keep
// their place, and edges theirs.

#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "raylift/lifting/geometry_source.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/scene/photographs.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

struct FusionOptions {
  // The distance between points of the grid, in scene units; nullopt: two pixels on the
  // surface (median), or how far the views disagree where that is more.
  std::optional<double> voxel = std::nullopt;
  // Distances are cut off there; nullopt: 4 voxels, or 3 times what the views disagree by.
  std::optional<double> truncation = std::nullopt;
  // Pieces of less surface than a square of so many voxels' side are left out, as what a few wrong
  // pixels make.
  double min_piece_voxels = 10;
  // The grid's memory; more is an OptionError that names a voxel that fits.
  size_t max_bytes = size_t{4} << 30;
  int threads = 0;
  std::function<void()> on_view = {};  // after each of twice as many as there are, from any thread
};

// What the views say of the scale of things.
struct ViewScale {
  double pixel_width = 0;     // median, on the surface, scene units
  double relative_noise = 0;  // standard deviation of depth as a share of it, by other views
  double noise = 0;           // the same in scene units, at the median depth
  // The part of the noise in which neighboring pixels differ, as a share of the depth.
  double relative_roughness = 0;
  size_t num_comparisons = 0;  // that tell the noise; 0: it is not known
};

struct FusedMesh {
  TriangleMesh mesh;  // front faces look at the cameras
  ViewScale scale;
  double voxel = 0;
  double truncation = 0;
  size_t grid_bytes = 0;
};

// Returns whether the library was built with OpenVDB, without which it cannot fuse.
bool CanFuse();
// Throws OptionError, which says what to install, where it cannot.
void RequireFusion();

// Returns the references as views at the size at which their geometry has values of its own: that
// of its depth maps; of any other source, which is seen by rays, with sides of at most
// `max_side_px`.
std::vector<PosedImage> ViewsToFuse(const NamedGeometry& geometry,
                                    std::span<const PosedImage> references, int max_side_px);

// Looks at the source through all pixels of the views. The same for any number of threads. Throws
// InputError where no view sees anything.
FusedMesh FuseViews(const GeometrySource& source, std::span<const PosedImage> views,
                    const FusionOptions& options = {});

}  // namespace raylift
