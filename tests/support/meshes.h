// Meshes with known shapes, and every kind of camera to look at them.

#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

#include "base/rng.h"

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

// Far from the origin, as coordinates of maps are.
inline const Eigen::Vector3d kGeoreferenced(4e5, 5e6, 300);

// A mesh of these world positions, recentered as ReadMesh does.
TriangleMesh MeshOfShape(const std::vector<Eigen::Vector3d>& positions,
                         std::vector<std::array<uint32_t, 3>> triangles);

// The square [-half, half]^2 at z = 0 in the frame of `world_from_plane`, wound so that its normal
// is -z, in cells x cells pairs of triangles.
TriangleMesh MakePlane(const Rigid3& world_from_plane, double half, int cells);

// An axis-aligned box, normals outward, two triangles per side.
TriangleMesh MakeBox(const Eigen::Vector3d& center, const Eigen::Vector3d& half_size);

// A sphere of latitude rings and longitude segments, normals outward, closed, vertices on the
// sphere.
TriangleMesh MakeSphere(const Eigen::Vector3d& center, double radius, int rings, int segments);

// A camera of each of COLMAP's models, 64 x 48 pixels, with distortion; all pixels have a ray.
std::vector<Camera> CamerasOfEveryModel();

// The pose of a camera at `center` that looks at `target`, image up roughly along -y of the world.
Rigid3 LookAt(const Eigen::Vector3d& center, const Eigen::Vector3d& target);

// Its principal point is the middle of the image.
Camera CenteredPinhole(int width_px, int height_px, double focal_px);

// Anywhere in the image.
std::vector<Eigen::Vector2d> RandomPixels(const Camera& camera, int count, Rng& rng);

}  // namespace raylift
