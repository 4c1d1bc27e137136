// Camera poses that together see a mesh's surfaces, from wherever there is room in front of them:
// for scenes that have neither a ground to walk on nor an outside to look from, such as a scan of
// one side of a room.

#pragma once

#include <cstdint>
#include <span>

#include "raylift/views/view_sampler.h"

namespace raylift {

struct CoveringOptions {
  // Distance from the surface that a camera looks at, as a share of the mesh's size (the diagonal
  // of its bounds without the outermost points).
  double min_distance = 0.12;
  double max_distance = 0.5;
  double min_coverage = 0.5;   // share of the picture that must see a surface
  double max_tilt_deg = 90.0;  // of the line of sight, above or below the horizon
};

// Of many random places in front of surfaces, those are taken, one by one, that add most: a surface
// point counts the less the more views see it already from a similar direction and distance.
// InputError where there is no place.
SampledViews SampleCovering(const RayCaster& mesh, const ViewSamplerOptions& options,
                            const CoveringOptions& covering);

// How well views show the mesh's surfaces: the sum, over points spread over them, of what
// SampleCovering counts for each view, per point. More views give more, views from other sides far
// more.
double CoverageOf(const RayCaster& mesh, const ViewSamplerOptions& options,
                  std::span<const Rigid3> cam_from_world);

// The diagonal of the mesh's bounds, the outermost 2 % of its area left out on each side.
double MeshSize(const TriangleMesh& mesh, uint64_t seed);

}  // namespace raylift
