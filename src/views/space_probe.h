// Finds where the surfaces of a scene leave room for cameras.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/rng.h"
#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/triangle_mesh.h"
#include "raylift/views/view_sampler.h"

namespace raylift {

struct Surroundings {
  double clearance;    // distance to the nearest surface in any direction; infinite: none
  double front_share;  // of the surfaces that are seen, those seen from their front; 1: none seen
};
Surroundings ProbeSurroundings(const RayCaster& mesh, const Eigen::Vector3d& center,
                               int directions);

struct VisibleSurface {
  double coverage = 0;      // share of the picture that sees a surface
  double front_share = 0;   // of that, seen from its front
  double median_range = 0;  // distance of what is seen
};
VisibleSurface MeasureView(const RayCaster& mesh, const Camera& camera,
                           const Rigid3& cam_from_world);

// The share of the seen surfaces that must be seen from the front; the rest may be thin things
// without a back.
constexpr double kMinFrontShare = 0.9;

// Directions in which surfaces are looked for: around every place, and where a camera shall stand.
constexpr int kFewDirections = 256;
constexpr int kManyDirections = 4096;

// Returns whether nothing is nearer than the clearance, and the place is within no solid body.
bool IsClear(const RayCaster& mesh, const Eigen::Vector3d& center,
             const ViewSamplerOptions& options, int directions);

struct EyePlace {
  Eigen::Vector3d center;
  std::vector<size_t> neighbors;  // places beside it, without a high step
};

// Returns clear places at eye height over the ground, on a grid, of the largest area of ground that
// is connected without high steps; empty if there is no such ground. Places that are not clear may
// separate them.
std::vector<EyePlace> FindEyePlaces(const RayCaster& mesh, const ViewSamplerOptions& options,
                                    const InsideOptions& inside);

// Returns indices of points, each as far as can be from all before it, the first at random.
std::vector<size_t> FarthestFirst(const std::vector<Eigen::Vector3d>& points, size_t count,
                                  Rng& rng);

}  // namespace raylift
