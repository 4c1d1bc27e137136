// Which way is up in a mesh that comes without a word on it.

#pragma once

#include <Eigen/Core>

#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

struct UpDirection {
  Eigen::Vector3d up_in_world{0, 0, 1};
  // No direction far from it explains the mesh nearly as well. Otherwise up is z.
  bool is_clear = false;
};

// By what the surfaces face, weighted by their area. Floors and walls are parallel or at right angles
// to up; and more faces up (floors, tables, ground, roofs) than down, as what faces down is rarely
// seen, while walls face each other. The direction with most of both is levelled by floors and
// walls. As most meshes have it, up is z where that explains the mesh about as well and twice as much
// faces it as faces away, and where it is within 2 degrees. The triangles have to be wound
// consistently (counterclockwise from the side that is looked at).
UpDirection EstimateUp(const TriangleMesh& mesh);

}  // namespace raylift
