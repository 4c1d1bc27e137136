// Where a mesh, point cloud or splats belong in the world of the references, for those in another
// unit, with other axes or about another origin:
//
//   point_in_world = scale * axes * point_in_mesh + shift

#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

#include <Eigen/Core>

#include "raylift/surfaces/point_cloud.h"
#include "raylift/surfaces/splats.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

struct MeshPlacement {
  double scale = 1;
  // Orthogonal; a mirror where its determinant is -1.
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();

  bool IsIdentity() const;
  bool IsMirror() const { return axes.determinant() < 0; }
  Eigen::Vector3d operator*(const Eigen::Vector3d& point_in_mesh) const {
    return scale * (axes * point_in_mesh) + shift;
  }
};

// First the right one, then the left one. What differs from no scale, axes or shift by no more than
// rounding is made none.
MeshPlacement operator*(const MeshPlacement& left, const MeshPlacement& right);
MeshPlacement Inverse(const MeshPlacement& placement);

// Signed permutations by what the world's x, y and z are in the mesh: "x/-z/y". None for what is
// not one.
std::optional<Eigen::Matrix3d> AxesFromName(std::string_view name);
// None of axes that are not a signed permutation.
std::optional<std::string> NameOfAxes(const Eigen::Matrix3d& axes);

// Of a 4 x 4 matrix row by row, all of it or its upper three rows; none where that is no
// similarity.
std::optional<MeshPlacement> PlacementFromMatrix(std::span<const double> row_major);

// In words: "the mesh times 0.001, mirrored (its -x/y/z are x/y/z)".
std::string Describe(const MeshPlacement& placement);

// The keys of mesh:..., cloud:... and splat:... that say it: "scale=0.001,axes=x/-z/y,shift=0/5/0", or
// "matrix=..." where the axes have no name. Empty where it does nothing.
std::string KeysOf(const MeshPlacement& placement);

// Triangles of a mirrored mesh are wound the other way, so that what was in front stays so.
TriangleMesh Placed(TriangleMesh mesh, const MeshPlacement& placement);
PointCloud Placed(PointCloud cloud, const MeshPlacement& placement);
Splats Placed(Splats splats, const MeshPlacement& placement);

}  // namespace raylift
