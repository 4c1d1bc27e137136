// Joins and inverts the placements of meshes, point clouds and splats, applies them, and has their
// names and keys.

#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <Eigen/Core>

#include "raylift/lifting/geometry_spec.h"
#include "raylift/surfaces/point_cloud.h"
#include "raylift/surfaces/splats.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

// Returns the placement that applies the right one first. A scale, axes or shift that differ from
// the identity by no more than rounding become the identity.
MeshPlacement operator*(const MeshPlacement& left, const MeshPlacement& right);
MeshPlacement Inverse(const MeshPlacement& placement);

// Returns the signed permutation by what the world's x, y and z are in the mesh ("x/-z/y"); nullopt
// for any other text.
std::optional<Eigen::Matrix3d> AxesFromName(std::string_view name);
// Returns nullopt for axes that are not a signed permutation.
std::optional<std::string> NameOfAxes(const Eigen::Matrix3d& axes);

// Reads a 4 x 4 matrix row by row, all of it or its upper three rows; returns nullopt where that is
// no similarity.
std::optional<MeshPlacement> PlacementFromMatrix(std::span<const double> row_major);

// Says it in words: "the mesh times 0.001, mirrored (its -x/y/z are x/y/z)".
std::string Describe(const MeshPlacement& placement);

// Returns the keys of mesh:..., cloud:... and splat:... for a placement:
// "scale=0.001,axes=x/-z/y,shift=0/5/0", or "matrix=..." where the axes have no name; no text for
// the identity.
std::string KeysOf(const MeshPlacement& placement);

// Return the surface in the world. Triangles of a mirrored mesh are wound the other way, so that
// front faces stay in front.
TriangleMesh Placed(TriangleMesh mesh, const MeshPlacement& placement);
PointCloud Placed(PointCloud cloud, const MeshPlacement& placement);
Splats Placed(Splats splats, const MeshPlacement& placement);

}  // namespace raylift
