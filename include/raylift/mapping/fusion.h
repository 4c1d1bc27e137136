// Fuses the geometry that many views see into one mesh: the zero of a weighted mean of truncated
// signed distances (Curless and Levoy 1996) on a sparse grid. Each view adds, at the grid's points
// about the surface that it sees, their signed distances from it, weighted by their precision;
// space that a view looks through is free, whatever other views put there.
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
  // This is the spacing of the grid, in scene units; with nullopt it is twice the median width of a
  // pixel on the surface, or the noise of the views where that is more.
  std::optional<double> voxel = std::nullopt;
  // Distances are truncated here, in scene units; nullopt: 4 voxels, or 3 times the noise of the
  // views.
  std::optional<double> truncation = std::nullopt;
  // Pieces of less area than a square of so many voxels' side are left out: a few wrong pixels make
  // such pieces.
  double min_piece_voxels = 10;
  // The most memory for the grid; where more is needed an OptionError names a voxel that fits.
  size_t max_bytes = size_t{4} << 30;
  int threads = 0;
  std::function<void()> on_view = {};  // after each of twice as many as there are, from any thread
};

// The resolution and the noise of the views' depth.
struct ViewScale {
  double pixel_width = 0;     // median, on the surface, scene units
  double relative_noise = 0;  // standard deviation of depth as a share of it, by other views
  double noise = 0;           // the same in scene units, at the median depth
  // The standard deviation of depth between neighboring pixels, as a share of it.
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
// Throws OptionError, which says what to install, where it was not.
void RequireFusion();

// Returns the references as views at the size at which their geometry has values of its own: that
// of its depth maps; of any other source, which is seen by rays, with sides of at most
// `max_side_px`.
std::vector<PosedImage> ViewsToFuse(const NamedGeometry& geometry,
                                    std::span<const PosedImage> references, int max_side_px);

// Lifts all pixels of the views and fuses them. The result does not depend on the number of
// threads. Throws InputError where no view sees anything.
FusedMesh FuseViews(const GeometrySource& source, std::span<const PosedImage> views,
                    const FusionOptions& options = {});

}  // namespace raylift
