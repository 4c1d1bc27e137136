// Samples camera poses on a mesh, for scenes without photographs: around an object, inside an
// environment, along a line, on foot, wherever there is room. All keep clear of the surfaces.

#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

struct ViewSamplerOptions {
  Camera camera;
  int count = 48;
  Eigen::Vector3d up_in_world{0, 0, 1};
  double clearance = 0.3;  // scene units to the nearest surface, in all directions
  uint64_t seed = 0;
  // Ignores which side of a triangle is seen, for meshes that are not wound consistently.
  bool any_side = false;
  int threads = 0;  // <= 0: all; never changes the views
};

struct SampledViews {
  std::vector<Rigid3> cam_from_world;
  std::vector<std::string> warnings;  // fewer places than wanted, ...
};

// Returns the mean direction, by area, of the surfaces that face `hint` to within 30 degrees,
// narrowed step by step to 5: up where the world's axes are only roughly level.
Eigen::Vector3d LevelUp(const TriangleMesh& mesh, const Eigen::Vector3d& hint);

// Samples views on a sphere around the mesh, evenly spread between two elevations (of the camera
// above the horizon; equal ones make a ring), looking at the mesh's middle.
struct AroundOptions {
  double min_elevation_deg = -20;
  double max_elevation_deg = 60;
  std::optional<double> distance = std::nullopt;  // nullopt: the whole mesh is in the picture
};
SampledViews SampleAround(const RayCaster& mesh, const ViewSamplerOptions& options,
                          const AroundOptions& around);

// Samples views at eye height above the ground on which one can walk: the largest area of upward
// faces that are connected without high steps and have room above them, so that neither roofs nor
// tables count. Places are spread over it; each camera looks along free space at surfaces whose
// front faces it, by the winding of the triangles, unless `any_side`. Throws InputError where there
// is no place.
struct InsideOptions {
  double eye_height = 1.6;
  double max_step = 0.4;      // between neighboring places
  double look_down_deg = 0;   // below the horizon
  double min_coverage = 0.6;  // share of the picture that must see a surface
};
SampledViews SampleInside(const RayCaster& mesh, const ViewSamplerOptions& options,
                          const InsideOptions& inside);
// Returns nullopt if there is no place.
std::optional<SampledViews> TrySampleInside(const RayCaster& mesh,
                                            const ViewSamplerOptions& options,
                                            const InsideOptions& inside);

// Samples views evenly along a line of camera centers, looking along it. Places that are not clear
// of surfaces or lie inside a body are left out with a warning; throws InputError where none is
// left.
SampledViews SampleAlong(const RayCaster& mesh, const ViewSamplerOptions& options,
                         std::span<const Eigen::Vector3d> line);

// Samples a walk over the ground of SampleInside, as of a person who carries a phone: past places
// that lie far apart, by the shortest way where there is room, its corners rounded, and again where
// there are more poses. Each camera looks ahead, bobs and sways with the steps and turns with the
// hand; a person who has to turn about stands. The content of the pictures is not tested
// (InsideOptions::min_coverage). Throws InputError where there is no way to walk.
struct WalkOptions {
  std::optional<double> spacing = std::nullopt;  // between poses; nullopt: a quarter of eye height
};
SampledViews SampleWalk(const RayCaster& mesh, const ViewSamplerOptions& options,
                        const InsideOptions& inside, const WalkOptions& walk = {});

// Returns the pose of a camera that looks along `forward`, with the picture's top toward `up`.
Rigid3 LookAlong(const Eigen::Vector3d& center, const Eigen::Vector3d& forward,
                 const Eigen::Vector3d& up);

// Samples views by choosing from many random places in front of surfaces, one by one, those that
// add most: a surface point counts the less the more views see it already from a similar direction
// and distance. Throws InputError where there is no place.
SampledViews SampleCovering(const RayCaster& mesh, const ViewSamplerOptions& options);

// Returns how well views cover the mesh's surfaces: the mean, over points spread over them, of the
// sum that SampleCovering maximizes. More views give more, views from other sides far more.
double CoverageOf(const RayCaster& mesh, const ViewSamplerOptions& options,
                  std::span<const Rigid3> cam_from_world);

// Returns the diagonal of the mesh's bounds, the outermost 2 % of its area left out on each side.
double MeshSize(const TriangleMesh& mesh, uint64_t seed);

struct UpDirection {
  Eigen::Vector3d up_in_world{0, 0, 1};
  // No direction far from it explains the mesh nearly as well. Otherwise up is z.
  bool is_clear = false;
};

// Estimates up from the directions that the surfaces face, weighted by their area. Floors and walls
// are parallel or at right angles to up; and more faces up (floors, tables, ground, roofs) than
// down, as what faces down is rarely seen, while walls face each other. The direction with most of
// both is levelled by floors and walls. As most meshes have it, up is z where that explains the
// mesh about as well and twice as much faces it as faces away, and where it is within 2 degrees.
// The triangles have to be wound consistently (counterclockwise from the side that is looked at).
UpDirection EstimateUp(const TriangleMesh& mesh);

}  // namespace raylift
