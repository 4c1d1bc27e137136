// The demo's place: a courtyard of 16 m x 12 m between four house fronts, with a fountain in its
// middle. World: meters, z up, the ground at z = 0, x to the east, y to the north, the origin in
// the south-west corner.

#pragma once

#include <cstdint>

#include "mesh_builder.h"
#include "scene_writer.h"

namespace raylift::demo {

struct Courtyard {
  TexturedScene scene;  // what the mesh file and the references show
  // What only the queries see: some things were put there since.
  MeshBuilder newcomers;
};

Courtyard BuildCourtyard(uint64_t seed);

}  // namespace raylift::demo
